// The reference algebra, compiled.
#include "reference.hpp"

#include <Eigen/LU>
#include <Eigen/QR>
#include <Eigen/SVD>

namespace reference {

Dense inverse(const Dense& A) { return A.inverse(); }

double determinant(const Dense& A) { return A.determinant(); }

Dense solve(const Dense& A, const Dense& b) { return A.colPivHouseholderQr().solve(b); }

Dense complement(const Dense& A) {
  const Dense Q = A.householderQr().householderQ();
  return Q.rightCols(A.rows() - A.cols()).transpose();
}

Eigen::VectorXd singular_values(const Dense& A) { return A.jacobiSvd().singularValues(); }

}  // namespace reference
