// Marginal likelihood of a log's rows under hypotheses: each one more column, beside the ordinary.
#include "calibration/evidence.hpp"

#include "estimation/estimate.hpp"
#include "estimation/evidence.hpp"

namespace truepose {
namespace {
/// [C | y | B], whitened against persisting errors. @return ½ ln of the determinant removed
double whiten(const LogRows& rows, const Ordinary& by, RowMatrix& Z) {
  if (!(by.persisting > 0)) return 0;
  const int count = rows.D.cols(), width = Z.cols();
  RowMatrix P(count, count), X(count, width);  // covariance and mean of η, of every column
  for (int i : range(count)) P(i, i) = by.persisting;
  double half = 0;
  int last = -1;
  for (int row : range(Z.rows())) {
    const int line = rows.line[row];
    if (line < 0) continue;
    if (last >= 0 && line != last) {
      const double kept = std::pow(by.correlation, line - last);
      for (double& entry : X) entry *= kept;
      for (double& entry : P) entry *= kept * kept;
      for (int i : range(count)) P(i, i) += (1 - kept * kept) * by.persisting;
    }
    last = line;
    const double* d = rows.D[row];
    const std::vector<double> Pd = P * std::vector<double>(d, d + count);
    const double variance = 1 + dot(count, d, Pd.data());
    double* z = Z[row];
    for (int i : range(count)) add_scaled(width, -d[i], X[i], z);
    for (int i : range(count)) {
      add_scaled(width, Pd[i] / variance, z, X[i]);
      add_scaled(count, -Pd[i] / variance, Pd.data(), P[i]);
    }
    for (int j : range(width)) z[j] /= sqrt(variance);
    half += 0.5 * log(variance);
  }
  return half;
}

/// Scalar products of whitened columns, those of a hypothesis with each other and with y alone.
struct Products {
  RowMatrix BB, BZ;  ///< of B with itself and with [C | y]
  RowMatrix CC;      ///< row k: of column k with those of its hypothesis
  std::vector<double> Cy;
  double yy = 0;
};

Products products(const RowMatrix& Z, const std::vector<int>& end, int columns) {
  const int p = Z.cols() - columns - 1;
  int most = 0;
  for (std::size_t h = 0; h < end.size(); ++h) most = max(most, end[h] - (h ? end[h - 1] : 0));
  Products of{RowMatrix(p, p), RowMatrix(p, columns + 1), RowMatrix(columns, most),
              std::vector<double>(columns)};
  for (int row : range(Z.rows())) {
    const double *z = Z[row], *b = z + columns + 1, y = z[columns];
    for (int i : range(p)) {
      if (b[i] == 0) continue;
      add_scaled(p, b[i], b, of.BB[i]);
      add_scaled(columns + 1, b[i], z, of.BZ[i]);
    }
    add_scaled(columns, y, z, of.Cy.data());
    of.yy += y * y;
    int first = 0;
    for (const int last : end) {
      for (int k : range(first, last)) add_scaled(last - first, z[k], z + first, of.CC[k]);
      first = last;
    }
  }
  return of;
}
}  // namespace

RowMatrix weigh(const LogRows& rows, const Columns& columns,
                const std::vector<Ordinary>& ordinary) {
  const int m = int(rows.y.size()), K = columns.C.cols(), p = rows.B.cols();
  RowMatrix result(int(ordinary.size()), 1 + int(columns.end.size()));
  Products of;
  double half = 0;
  for (int a : range(result.rows())) {
    const Ordinary& by = ordinary[a];
    const Ordinary* before = a ? &ordinary[a - 1] : nullptr;
    if (!before || before->persisting != by.persisting || before->correlation != by.correlation) {
      RowMatrix Z(m, K + 1 + p);
      for (int row : range(m)) {
        std::copy_n(columns.C[row], K, Z[row]);
        Z(row, K) = rows.y[row];
        std::copy_n(rows.B[row], p, Z[row] + K + 1);
      }
      half = whiten(rows, by, Z);
      of = products(Z, columns.end, K);
    }
    // (s² I + t² B Bᵀ)⁻¹ = s⁻² (I - (t/s)² B M⁻¹ Bᵀ), M = I + (t/s)² BᵀB = L Lᵀ (Woodbury).
    const double s2 = by.noise * by.noise, ratio = by.tolerances / by.noise;
    RowMatrix M = RowMatrix::identity(p), V = of.BZ;
    for (int i : range(p)) add_scaled(p, ratio * ratio, of.BB[i], M[i]);
    const RowMatrix L = cholesky(M);
    solve_lower(L, V);
    for (double& entry : V) entry *= ratio;
    const auto taken = [&](int i, int j) {  // by B, of the product of columns i and j
      return sum_of(p, [&](int k) { return V(k, i) * V(k, j); });
    };
    double likelihood = -half - m * (log(by.noise) + 0.5 * log(2 * kPi));
    for (int i : range(p)) likelihood -= log(L(i, i));
    likelihood -= 0.5 * (of.yy - taken(K, K)) / s2;
    result(a, 0) = likelihood;
    int first = 0;
    for (std::size_t h = 0; h < columns.end.size(); ++h) {
      const int count = columns.end[h] - first;
      RowMatrix A(count, count);
      std::vector<double> b(count);
      for (int i : range(count)) {
        b[i] = (of.Cy[first + i] - taken(first + i, K)) / s2;
        for (int j : range(count))
          A(i, j) = (of.CC(first + i, j) - taken(first + i, first + j)) / s2;
      }
      result(a, int(h) + 1) = likelihood + evidence(count, A.data(), b.data()).log_odds;
      first = columns.end[h];
    }
  }
  return result;
}
}  // namespace truepose
