// Matrices whose size is known at run time only, for offline code, and the algebra that it needs.
#pragma once

#include <vector>

#include "math/real.hpp"

namespace truepose {
/// A matrix of doubles, by rows.
class RowMatrix : std::vector<double> {
 public:
  using vector::begin, vector::end, vector::data;

  RowMatrix() = default;
  /// Zeros, or a copy of rows × columns numbers.
  RowMatrix(int rows, int columns, const double* from = nullptr)
      : vector(std::size_t(rows) * columns), rows_(rows), columns_(columns) {
    if (from) std::copy_n(from, size(), begin());
  }
  static RowMatrix identity(int size) {
    RowMatrix I(size, size);
    for (int i : range(size)) I(i, i) = 1;
    return I;
  }

  int rows() const { return rows_; }
  int cols() const { return columns_; }
  double operator()(int i, int j) const { return (*this)[i][j]; }
  double& operator()(int i, int j) { return (*this)[i][j]; }
  /// Row i.
  const double* operator[](int i) const { return data() + long(i) * columns_; }
  double* operator[](int i) { return data() + long(i) * columns_; }

 private:
  int rows_ = 0, columns_ = 0;
};

RowMatrix transposed(const RowMatrix& A);
RowMatrix operator*(const RowMatrix& A, const RowMatrix& B);
std::vector<double> operator*(const RowMatrix& A, const std::vector<double>& b);
/// A ± B.
RowMatrix sum(RowMatrix A, const RowMatrix& B, double sign = 1);

/// to += factor · row, both of `count` numbers.
void add_scaled(int count, double factor, const double* row, double* to);

/// N + BᵀB, of a symmetric N.
RowMatrix plus_gram(RowMatrix N, const RowMatrix& B);

/// Lower triangular L with L Lᵀ = A, symmetric and positive definite; otherwise NaNs follow.
RowMatrix cholesky(const RowMatrix& A);
/// L⁻¹ B and L⁻ᵀ B of a lower triangular L, in place.
void solve_lower(const RowMatrix& L, RowMatrix& B);
void solve_lower_transposed(const RowMatrix& L, RowMatrix& B);
/// (L Lᵀ)⁻¹ b.
std::vector<double> solve_cholesky(const RowMatrix& L, const std::vector<double>& b);

/// Singular values of A: A V has orthogonal columns of these lengths, the longest first; V Vᵀ = I.
struct SingularValues {
  RowMatrix AV, V;
  std::vector<double> length;
  /// Number of lengths above rounding.
  int rank() const;
  /// A⁺: of least squares, or of the smallest solution. Only for A of full rank.
  RowMatrix inverse() const;
};
/// @param A  at least as many rows as columns
SingularValues singular_values(const RowMatrix& A);
}  // namespace truepose
