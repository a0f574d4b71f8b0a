#include "calibration/dense.hpp"

namespace truepose {
Mat3 plain(const Dense3& A) {
  Mat3 result;
  Eigen::Map<Dense3>(result.data()) = A;
  return result;
}
}  // namespace truepose
