// Reference results. Textbook algebra on matrices of any size, by Eigen's own
// decompositions: compiled once for all tests, each of which would spend seconds on them.
#pragma once

#include <Eigen/Core>

#include "calibration/dense.hpp"
#include "math/vec3.hpp"

namespace reference {

using Dense = Eigen::MatrixXd;
using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// The core's numbers as Eigen's, without a copy.
inline Eigen::Map<const Rows> dense(const truepose::RowMatrix& A) {
  return {A.data(), A.rows(), A.cols()};
}
inline Eigen::Map<const Eigen::VectorXd> dense(const std::vector<double>& a) {
  return {a.data(), static_cast<long>(a.size())};
}
/// Eigen's as the core's.
inline truepose::RowMatrix plain(const Rows& A) {
  return {static_cast<int>(A.rows()), static_cast<int>(A.cols()), A.data()};
}
inline std::vector<double> list(const Eigen::VectorXd& a) { return {a.begin(), a.end()}; }

Dense inverse(const Dense& A);
double determinant(const Dense& A);

/// x of least |A x - b|, by QR: the condition number is not squared.
Dense solve(const Dense& A, const Dense& b);

/// An orthonormal basis, in rows, of the space orthogonal to A's columns: N A = 0, N Nᵀ = 1.
Dense complement(const Dense& A);

truepose::Mat3 turn(double angle, const truepose::Vec3& axis);

/// The largest first.
Eigen::VectorXd singular_values(const Dense& A);

}  // namespace reference
