// Differences between visited poses as linear equations in ξ, with the poses eliminated.
#include "calibration/links.hpp"

#include <numeric>

namespace truepose {
void LinkBlock::weigh(std::vector<double> by) {
  weight = std::move(by);
  C = shared;
  for (int k : range(size())) C(k, k) += 1 / weight[k];
  C = cholesky(C);
}

void LinkBlock::weigh(const RowLoss& loss, const std::vector<char>& outlier) {
  const auto out = [&](int k) { return outlier[link[k]]; };
  std::vector<double> first(size(), 1.0);
  for (int k : range(size()))
    if (out(k)) first[k] = kNothing;
  weigh(first);
  for (int round = 0; round < 100; ++round) {
    const std::vector<double> z = solve_cholesky(C, y);
    std::vector<double> next(size());
    double change = 0;
    cost = 0;
    for (int k : range(size())) {
      const double own = z[k] / weight[k];  // ε
      cost += z[k] * (y[k] - own) + (out(k) ? 0 : loss.cost(own * own, 1));
      next[k] = out(k) ? kNothing : max(loss.weight(own * own, 1), kNothing);
      change = max(change, fabs(next[k] - weight[k]));
    }
    if (change < 1e-9) break;
    weigh(next);
  }
}

LinkExpected expected(Mobility mobility, const Link& link, const Pose* poses, const double* w) {
  LinkExpected result;
  const Vec3 c(w[link.tool], w[link.tool + 1], w[link.tool + 2]);
  const double* shape = w + link.shape;
  std::array<Vec3, 2> arm, p, slope;  // slope: ∂f/∂p
  for (int a : range(link.ends())) {
    const Pose& pose = poses[link.line[a]];
    arm[a] = pose.R * c;
    p[a] = pose.D + arm[a];
  }
  switch (link.kind) {
    case LinkKind::plane: {
      const int first = (link.axis + 1) % 3, second = (link.axis + 2) % 3;
      const Vec3& at = p[0];
      result.value = at[link.axis] - shape[0] - shape[1] * at[first] - shape[2] * at[second];
      slope[0] =
          Vec3::Unit(link.axis) - shape[1] * Vec3::Unit(first) - shape[2] * Vec3::Unit(second);
      result.shape = {-1, -at[first], -at[second]};
      break;
    }
    case LinkKind::distance: {
      const Vec3 apart = p[0] - p[1];
      const double distance = apart.norm();
      result.value = (1 + shape[0]) * distance + link.times * shape[1];
      slope[0] = (1 + shape[0]) * (distance > 0 ? apart / distance : Vec3::Zero());
      slope[1] = -slope[0];
      result.shape = {distance, link.times, 0};
      break;
    }
    case LinkKind::point:
      result.value = (p[0] - p[1])[link.axis];
      slope[0] = Vec3::Unit(link.axis);
      slope[1] = -slope[0];
      break;
  }
  for (int a : range(link.ends())) {
    free_row({mobility, dof(mobility), {}, {}, {}, {}}, slope[a], arm[a].cross(slope[a]),
             result.H_x[a].data());
    const Vec3 own = poses[link.line[a]].R.transpose() * slope[a];
    for (int k : range(3)) result.tool[k] += own[k];
  }
  return result;
}

namespace {
/// Groups the links of known rows by shared rows. @param n  equations of a row with a pose
std::vector<LinkBlock> grouped(const Links& links, const std::vector<Line>& lines, int n) {
  std::vector<int> group(lines.size()), block(lines.size(), -1);
  std::iota(group.begin(), group.end(), 0);
  const auto last = [](const Link& link) { return link.line[link.ends() - 1]; };
  const auto usable = [&](const Link& link) {
    return lines[link.line[0]].rows >= n && lines[last(link)].rows >= n;
  };
  for (const Link& link : links.link)
    if (usable(link)) std::ranges::replace(group, int(group[last(link)]), int(group[link.line[0]]));
  std::vector<LinkBlock> blocks;
  for (int k = 0; k < int(links.link.size()); ++k) {
    const Link& link = links.link[k];
    if (!usable(link)) continue;
    int& at = block[group[link.line[0]]];
    if (at < 0) {
      at = int(blocks.size());
      blocks.emplace_back();
    }
    for (int a : range(link.ends())) blocks[at].end.push_back({blocks[at].size(), link.line[a]});
    blocks[at].link.push_back(k);
  }
  return blocks;
}

}  // namespace

std::vector<LinkBlock> linked(Mobility mobility, const Links& links, const double* w,
                              const Knowledge& known, const std::vector<Pose>& poses,
                              const std::vector<Line>& lines) {
  const int n = dof(mobility), p = known.count;
  std::vector<LinkBlock> blocks = grouped(links, lines, n);
  for (LinkBlock& all : blocks) {
    const int m = all.size(), ends = int(all.end.size());
    all.e.resize(m);
    all.B = RowMatrix(m, p);
    all.G = RowMatrix(ends, n);
    all.shared = RowMatrix(m, m);
    for (int k = 0, end = 0; k < m; ++k) {
      const Link& link = links.link[all.link[k]];
      const LinkExpected at = expected(mobility, link, poses.data(), w);
      all.e[k] = (link.measured - at.value) / link.sigma;
      for (int i : range(3)) {
        all.B(k, links.first + link.tool + i) += at.tool[i] / link.sigma;
        if (at.shape[i] != 0) all.B(k, links.first + link.shape + i) += at.shape[i] / link.sigma;
      }
      for (int a = 0; a < link.ends(); ++a, ++end) {
        const Line& line = lines[link.line[a]];
        double* g = all.G[end];  // g R = ∂f/∂x
        for (int j : range(n)) {
          g[j] = at.H_x[a][j] / link.sigma;
          for (int i : range(j)) g[j] -= g[i] * line.R[i][j];
          g[j] /= line.R[j][j];
        }
      }
    }
    times_root(known, m, all.B.data());
    all.y = all.e;
    for (int k : range(ends)) {
      const auto [own, at] = all.end[k];
      const Line& line = lines[at];
      for (int i : range(n)) {
        add_scaled(p, -all.G(k, i), line.B[i], all.B[own]);
        all.y[own] -= all.G(k, i) * line.e[i];
      }
      for (int l : range(ends))
        if (all.end[l].line == at) all.shared(own, all.end[l].link) += dot(n, all.G[k], all.G[l]);
    }
    all.weigh(std::vector<double>(m, 1.0));
  }
  return blocks;
}

int equation_count(const std::vector<Line>& lines, const std::vector<LinkBlock>& blocks) {
  int sum = 0;
  for (const Line& each : lines) sum += each.redundancy();
  for (const LinkBlock& each : blocks) sum += each.size();
  return sum;
}

void each_equation(const std::vector<Line>& lines, const std::vector<LinkBlock>& blocks,
                   const std::function<void(const double*, double, int, bool)>& f) {
  for (const Line& line : lines)
    for (int i : range(line.n, line.rows))
      f(line.B[i], line.e[i], int(&line - lines.data()), false);
  for (const LinkBlock& block : blocks) {
    RowMatrix B = block.B, y(block.size(), 1, block.y.data());
    solve_lower(block.C, B);
    solve_lower(block.C, y);
    for (int k : range(block.size())) f(B[k], y(k, 0), block.end[0].line, true);
  }
}

void pull(const LinkBlock& block, const std::vector<double>& step, std::vector<Line>& lines) {
  std::vector<double> left = block.B * step;
  for (int k : range(block.size())) left[k] = block.y[k] - left[k];
  const std::vector<double> z = solve_cholesky(block.C, left);
  for (std::size_t k = 0; k < block.end.size(); ++k)
    for (int i : range(block.G.cols()))
      lines[block.end[k].line].pull[i] += z[block.end[k].link] * block.G(k, i);
}

void cross_validate(const Links& links, const LinkBlock& block, const RowMatrix& root,
                    std::vector<LinkResult>& result) {
  const int m = block.size();
  RowMatrix inverse = RowMatrix::identity(m);
  solve_lower(block.C, inverse);
  solve_lower_transposed(block.C, inverse);
  RowMatrix half = transposed(block.B) * inverse;
  solve_lower(root, half);
  const std::vector<double> z = inverse * block.y;
  for (int k : range(m)) {
    LinkResult& of = result[block.link[k]];
    const double sigma = links.link[block.link[k]].sigma;
    double P = inverse(k, k);
    for (int i : range(half.rows())) P -= half(i, k) * half(i, k);
    of.residual = sigma * block.e[k];
    of.left_out = sigma * z[k] / P;
    of.sigma = sigma * sqrt(max(1 / P - 1 / block.weight[k], 0.0) + 1);
  }
}
}  // namespace truepose
