// Reference results. Textbook algebra on matrices of any size, by Eigen's own
// decompositions: compiled once for all tests, each of which would spend seconds on them.
#pragma once

#include <Eigen/Core>

namespace reference {

using Dense = Eigen::MatrixXd;

Dense inverse(const Dense& A);
double determinant(const Dense& A);

/// x of least |A x - b|, by QR: the condition number is not squared.
Dense solve(const Dense& A, const Dense& b);

/// An orthonormal basis, in rows, of the space orthogonal to A's columns: N A = 0, N Nᵀ = 1.
Dense complement(const Dense& A);

/// The largest first.
Eigen::VectorXd singular_values(const Dense& A);

}  // namespace reference
