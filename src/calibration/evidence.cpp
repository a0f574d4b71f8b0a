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

/// Scalar products of whitened columns.
struct Products {
  RowMatrix yB;  ///< of [y | B] with [C | y | B]
  RowMatrix CC;  ///< row k: of column k of C with those of its hypothesis
};

Products products(const RowMatrix& Z, const std::vector<int>& end, int columns) {
  int most = 0;
  for (std::size_t h = 0; h < end.size(); ++h) most = max(most, end[h] - (h ? end[h - 1] : 0));
  Products of{RowMatrix(Z.cols() - columns, Z.cols()), RowMatrix(columns, most)};
  for (int row : range(Z.rows())) {
    const double* z = Z[row];
    for (int i : range(of.yB.rows()))
      if (z[columns + i] != 0) add_scaled(Z.cols(), z[columns + i], z, of.yB[i]);
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
    RowMatrix M = RowMatrix::identity(p), V(p, K + 1);
    for (int i : range(p)) {
      add_scaled(p, ratio * ratio, of.yB[1 + i] + K + 1, M[i]);
      add_scaled(K + 1, ratio, of.yB[1 + i], V[i]);
    }
    const RowMatrix L = cholesky(M);
    solve_lower(L, V);
    const auto taken = [&](int i, int j) {  // by B, of the product of columns i and j
      return sum_of(p, [&](int k) { return V(k, i) * V(k, j); });
    };
    double likelihood = -half - m * (log(by.noise) + 0.5 * log(2 * kPi));
    for (int i : range(p)) likelihood -= log(L(i, i));
    likelihood -= 0.5 * (of.yB(0, K) - taken(K, K)) / s2;
    result(a, 0) = likelihood;
    int first = 0;
    for (std::size_t h = 0; h < columns.end.size(); ++h) {
      const int count = columns.end[h] - first;
      RowMatrix A(count, count);
      std::vector<double> b(count);
      for (int i : range(count)) {
        b[i] = (of.yB(0, first + i) - taken(first + i, K)) / s2;
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
