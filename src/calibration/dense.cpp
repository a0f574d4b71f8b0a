// Matrices whose size is known at run time only, for offline code, and the algebra that it needs.
#include "calibration/dense.hpp"

#include <limits>
#include <numeric>

#include "estimation/estimate.hpp"

namespace truepose {
RowMatrix transposed(const RowMatrix& A) {
  RowMatrix T(A.cols(), A.rows());
  for (int i : range(A.rows()))
    for (int j : range(A.cols())) T(j, i) = A(i, j);
  return T;
}

void add_scaled(int count, double factor, const double* row, double* to) {
  for (int j : range(count)) to[j] += factor * row[j];
}

RowMatrix operator*(const RowMatrix& A, const RowMatrix& B) {
  RowMatrix product(A.rows(), B.cols());
  for (int i : range(A.rows()))
    for (int k : range(A.cols()))
      if (A(i, k) != 0) add_scaled(B.cols(), A(i, k), B[k], product[i]);
  return product;
}

std::vector<double> operator*(const RowMatrix& A, const std::vector<double>& b) {
  std::vector<double> product(A.rows());
  for (int i : range(A.rows())) product[i] = dot(A.cols(), A[i], b.data());
  return product;
}

RowMatrix sum(RowMatrix A, const RowMatrix& B, double sign) {
  add_scaled(A.rows() * A.cols(), sign, B.data(), A.data());
  return A;
}

RowMatrix plus_gram(RowMatrix N, const RowMatrix& B) {
  const int p = B.cols();
  int row = 0;
  for (; row + 4 <= B.rows(); row += 4) {  // four rows at once: N passes through the cache once
    const double *a = B[row], *b = B[row + 1], *c = B[row + 2], *d = B[row + 3];
    for (int i : range(p)) {
      double* to = N[i];
      for (int j : range(i + 1)) to[j] += a[i] * a[j] + b[i] * b[j] + (c[i] * c[j] + d[i] * d[j]);
    }
  }
  for (; row < B.rows(); ++row)
    for (int i : range(p)) add_scaled(i + 1, B(row, i), B[row], N[i]);
  for (int i : range(p))
    for (int j : range(i)) N(j, i) = N(i, j);
  return N;
}

RowMatrix cholesky(const RowMatrix& A) {
  const int p = A.rows();
  RowMatrix L(p, p);
  for (int i : range(p))
    for (int j : range(i + 1)) {
      const double rest = A(i, j) - dot(j, L[i], L[j]);
      L(i, j) = i > j ? rest / L(j, j) : sqrt(rest);
    }
  return L;
}

void solve_lower(const RowMatrix& L, RowMatrix& B) {
  for (int i : range(L.rows())) {
    for (int k : range(i))
      if (L(i, k) != 0) add_scaled(B.cols(), -L(i, k), B[k], B[i]);
    for (int j : range(B.cols())) B(i, j) /= L(i, i);
  }
}

void solve_lower_transposed(const RowMatrix& L, RowMatrix& B) {
  for (int i = L.rows(); i-- > 0;) {
    for (int j : range(B.cols())) B(i, j) /= L(i, i);
    for (int k : range(i))
      if (L(i, k) != 0) add_scaled(B.cols(), -L(i, k), B[i], B[k]);
  }
}

std::vector<double> solve_cholesky(const RowMatrix& L, const std::vector<double>& b) {
  RowMatrix x(int(b.size()), 1, b.data());
  solve_lower(L, x);
  solve_lower_transposed(L, x);
  return {x.begin(), x.end()};
}

int SingularValues::rank() const {
  const double least = std::numeric_limits<double>::epsilon() * AV.rows();
  return int(std::count_if(length.begin(), length.end(),
                           [&](double one) { return one > least * length[0]; }));
}

RowMatrix SingularValues::inverse() const {
  RowMatrix scaled = V;
  for (int i : range(V.rows()))
    for (int j : range(V.cols())) scaled(i, j) /= length[j] * length[j];
  return scaled * transposed(AV);
}

// Hestenes' one-sided Jacobi method: each rotation makes two columns of A V orthogonal. Those of V
// follow, each behind its column.
SingularValues singular_values(const RowMatrix& A) {
  const int n = A.cols(), m = A.rows();
  std::vector<std::vector<double>> column(n, std::vector<double>(m + n));
  for (int j : range(n)) {
    for (int i : range(m)) column[j][i] = A(i, j);
    column[j][m + j] = 1;
  }
  const auto along = [&](int i, int j) { return dot(m, column[i].data(), column[j].data()); };
  bool turned = true;
  for (int sweep = 0; turned && sweep < 40; ++sweep) {
    turned = false;
    for (int i : range(n))
      for (int j : range(i + 1, n)) {
        const double a = along(i, i), b = along(j, j), c = along(i, j);
        if (!(fabs(c) > 1e-15 * sqrt(a * b))) continue;
        turned = true;
        const double zeta = (b - a) / (2 * c);
        const double t = copysign(1, zeta) / (fabs(zeta) + sqrt(1 + zeta * zeta));
        const double cosine = 1 / sqrt(1 + t * t), sine = cosine * t;
        for (int k : range(m + n)) {
          const double x = column[i][k], y = column[j][k];
          column[i][k] = cosine * x - sine * y;
          column[j][k] = sine * x + cosine * y;
        }
      }
  }
  std::ranges::sort(column, [&](const auto& x, const auto& y) {
    return dot(m, x.data(), x.data()) > dot(m, y.data(), y.data());
  });
  SingularValues result{{m, n}, {n, n}, {}};
  for (int j : range(n)) {
    result.length.push_back(sqrt(along(j, j)));
    for (int i : range(m)) result.AV(i, j) = column[j][i];
    for (int i : range(n)) result.V(i, j) = column[j][m + i];
  }
  return result;
}
}  // namespace truepose
