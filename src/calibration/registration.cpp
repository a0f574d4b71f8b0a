// Registration of an external measurement: frame of the tracker and place of the marker.
#include "calibration/registration.hpp"

#include "calibration/dense.hpp"

namespace truepose {
Registration moved(const Registration& from, const double* step) {
  const auto at = [&](int first) { return Vec3(step[first], step[first + 1], step[first + 2]); };
  return {{from.base.t + at(0), exp_so3(at(3)) * from.base.R},
          {from.marker.t + at(6), exp_so3(at(9)) * from.marker.R}};
}

namespace {
/// Enters derivatives of the marker's turn about `about`. @param turn  platform to tracker
void enter_turn(Mobility mobility, const Registration& by, const Mat3& turn, const Vec3& about,
                int i, Seen& to) {
  free_row({mobility, dof(mobility), {}, {}, {}, {}}, Vec3::Zero(), by.base.R.transpose() * about,
           to.H_x[i].data());
  copy_first(3, about, to.H[i].begin() + 3);
  const Vec3 own = turn.transpose() * about;
  copy_first(3, own, to.H[i].begin() + 9);
}

}  // namespace

Seen seen(Mobility mobility, const Registration& by, const Pose& pose) {
  if (is_rotational(mobility) || is_mechanism(mobility)) {
    Seen angles{pose.D, Mat3::Identity(), {}, {}, 1};
    for (int i : range(dof(mobility))) angles.H_x[i][i] = 1;
    return angles;
  }
  const int positions = positions_of(mobility);
  const Mat3 turn = by.base.R * pose.R;
  const Vec3 arm = pose.R * by.marker.t, lever = by.base.R * (pose.D + arm);
  Seen result{by.base.t + lever, turn * by.marker.R, {}, {}, 1};
  for (int i : range(dof(mobility))) {
    auto& row = result.H[i];
    if (i < positions) {
      const Vec3 along = by.base.R.transpose().col(i);
      free_row({mobility, dof(mobility), {}, {}, {}, {}}, along, arm.cross(along),
               result.H_x[i].data());
      row[i] = 1;
      copy_first(3, lever.cross(Vec3::Unit(i)), row.begin() + 3);
      copy_first(3, turn.transpose().col(i), row.begin() + 6);
    } else {
      Vec3 about = Vec3::Unit(i - positions);  // axis of the turn that this coordinate measures
      if (turns_about_z(mobility)) {
        const Vec3 a = result.Q.col(0);
        const double level2 = a.x() * a.x() + a.y() * a.y();
        about = Vec3(-a.x() * a.z() / level2, -a.y() * a.z() / level2, 1);
        result.blunt = 1 / sqrt(level2);
      }
      enter_turn(mobility, by, turn, about, i, result);
    }
  }
  return result;
}

Coordinates innovation(Mobility mobility, const Seen& expected, const double* measured) {
  Coordinates apart;
  apart.fill(NAN);
  const int n = dof(mobility);
  for (int i = 0; i < n && i < 3; ++i) apart[i] = measured[i] - expected.p[i];
  if (turns_about_z(mobility))
    apart[n - 1] = remainder(measured[n - 1] - atan2(expected.Q(1, 0), expected.Q(0, 0)), 2 * kPi);
  if (mobility == Mobility::spatial) {
    const Vec3 turn =
        log_so3(exp_so3(Vec3(measured[3], measured[4], measured[5])) * expected.Q.transpose());
    copy_first(3, turn, apart.begin() + 3);
  }
  return apart;
}

void in_turns(Mobility mobility, const Registration& by, const Pose& pose, Seen& expected,
              Coordinates& apart) {
  if (turns_about_z(mobility)) {
    const int i = dof(mobility) - 1;
    const Vec3 a = expected.Q.col(0);
    const double sine = sqrt(a.x() * a.x() + a.y() * a.y());  // no hypot: glibc 2.35
    const Vec3 of_angle(-a.x() * a.z() / sine, -a.y() * a.z() / sine, sine);
    const Vec3 of_sine(-a.y() * a.z() / sine, a.x() * a.z() / sine, 0);
    enter_turn(mobility, by, by.base.R * pose.R, of_angle - apart[i] * of_sine, i, expected);
    apart[i] *= sine;
  }
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + long(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

Mat3 nearest_rotation(const Mat3& A) {
  const SingularValues of = singular_values(RowMatrix(3, 3, A.transpose().data()));
  const auto column = [](const RowMatrix& M, int j) { return Vec3(M(0, j), M(1, j), M(2, j)); };
  // U Vᵀ, the third columns such that both are rotations; on a line the second is any.
  const Vec3 u = column(of.AV, 0).normalized(), v = column(of.V, 0), v2 = column(of.V, 1);
  const Vec3 u2 = of.length[1] > 0 ? column(of.AV, 1).normalized() : normal_to(u);
  return outer(u, v) + outer(u2, v2) + outer(u.cross(u2), v.cross(v2));
}

namespace {
/// A marker's place by the robot and as measured at a row.
struct Pair {
  Vec3 from, to;
  int line;
  double weight = 1;
};

/// The marker's orientation from measured ones; `known` where there are none.
Mat3 marker_turn(Mobility mobility, const Mat3& base, const Mat3& known,
                 const std::vector<Pair>& pairs, const Pose* pose, const double* measured) {
  const int n = dof(mobility);
  Mat3 sum = Mat3::Zero();  // of the estimates of M, by row
  for (const Pair& p : pairs) {
    const double* x = measured + p.line * n;
    const Mat3 back = (base * pose[p.line].R).transpose();
    if (mobility == Mobility::spatial) {
      if (isfinite(x[3] + x[4] + x[5])) sum += p.weight * back * exp_so3(Vec3(x[3], x[4], x[5]));
    } else if (turns_about_z(mobility)) {
      const Vec3 axis = back * Vec3(cos(x[n - 1]), sin(x[n - 1]), 0);
      if (axis.allFinite()) sum += p.weight * rotation_z(atan2(axis.y(), axis.x()));
    }
  }
  return sum.norm() > 0 ? nearest_rotation(sum) : known;
}

}  // namespace

Registration registered(Mobility mobility, const Registration& known, bool moved, bool movable,
                        bool turning, int count, const Pose* pose, const Status* status,
                        const double* measured) {
  if (is_rotational(mobility) || is_mechanism(mobility)) return known;
  std::vector<Pair> pairs;
  Vec3 shift = Vec3::Zero(), counted = Vec3::Zero();
  for (int k : range(count)) {
    if (status[k] != Status::ok) continue;
    const Vec3 from = pose[k].D + pose[k].R * known.marker.t;
    Vec3 to = Vec3::Zero();
    for (int i : range(positions_of(mobility))) {
      to[i] = measured[k * dof(mobility) + i];
      if (isfinite(to[i])) shift[i] += (to[i] - from[i] - shift[i]) / ++counted[i];  // mean
    }
    if (to.allFinite()) pairs.push_back({from, to, k});
  }
  Registration result = known;
  if (moved) result.base = {shift, Mat3::Identity()};
  for (int round = 0; round < 50 && !pairs.empty(); ++round) {
    double total = 0;
    for (const auto& p : pairs) total += p.weight;
    // Means; of a known base its origin.
    Vec3 from = Vec3::Zero(), to = moved ? Vec3::Zero() : result.base.t;
    Mat3 turn = Mat3::Zero(), H = Mat3::Zero();
    if (moved) {
      for (const auto& p : pairs) {
        from += p.weight / total * p.from;
        to += p.weight / total * p.to;
        turn += p.weight / total * pose[p.line].R;
      }
      for (const auto& p : pairs) H += p.weight * outer(p.to - to, p.from - from);
      const std::vector<double> spans = singular_values(RowMatrix(3, 3, H.data())).length;
      if (!(spans[1] > 1e-6 * spans[0])) return result;  // on a line, or at one point
      result.base.R = nearest_rotation(H);
      result.base.t = to - result.base.R * from;
    }
    std::vector<double> apart;
    for (const auto& p : pairs)
      apart.push_back((p.to - result.base.t - result.base.R * p.from).squaredNorm());
    const double middle = median(apart);
    for (std::size_t k = 0; k < pairs.size(); ++k)
      pairs[k].weight = middle > 0 ? 1 / (1 + apart[k] / middle) : 1;
    if (!movable) continue;
    // R_k - mean R determines c. The prior 1e-3, a turn of 2°, is for an arm that hardly turns.
    Mat3 N = 1e-3 * total * Mat3::Identity();
    Vec3 b = Vec3::Zero();
    for (const auto& p : pairs) {
      const Mat3 A = pose[p.line].R - turn;
      N += p.weight * (A.transpose() * A);
      b += p.weight * (A.transpose() * (result.base.R.transpose() * (p.to - to) - (p.from - from)));
    }
    Vec3 step = b;
    Ldlt(3, N.data(), 3, std::array{N(0, 0), N(1, 1), N(2, 2)}.data()).solve(step);
    result.marker.t += step;
    for (auto& p : pairs) p.from += pose[p.line].R * step;
    result.base.t -= result.base.R * turn * step;
    if (round > 10 && step.norm() < 1e-5) break;
  }
  if (turning)
    result.marker.R = marker_turn(mobility, result.base.R, known.marker.R, pairs, pose, measured);
  return result;
}
}  // namespace truepose
