// Matrices whose size is known at run time only, for offline code: Eigen's.
#pragma once

#include <Eigen/Core>

#include "math/vec3.hpp"

namespace truepose {
using RowMatrix = Eigen::Matrix<Real, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using Dense3 = Eigen::Matrix<Real, 3, 3>;

/// A matrix of space as one of Eigen's, and back.
inline Dense3 dense(const Mat3& A) { return Eigen::Map<const Dense3>(A.data()); }
Mat3 plain(const Dense3& A);
}  // namespace truepose
