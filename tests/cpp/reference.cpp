// The reference algebra, compiled.
#include "reference.hpp"

#include <Eigen/Geometry>
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

truepose::Mat3 turn(double angle, const truepose::Vec3& axis) {
  truepose::Mat3 R;
  Eigen::Map<Eigen::Matrix3d>(R.data()) =
      Eigen::AngleAxisd(angle, Eigen::Vector3d(axis.x(), axis.y(), axis.z())).toRotationMatrix();
  return R;
}

Eigen::VectorXd singular_values(const Dense& A) { return A.jacobiSvd().singularValues(); }

}  // namespace reference
