// Matrices of the core as numpy arrays, copied.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <algorithm>

#include "calibration/registration.hpp"

namespace truepose::python {
/// The frame of a homogeneous matrix.
inline Frame frame_of(const RowMatrix& T) {
  return {
      {T(0, 3), T(1, 3), T(2, 3)},
      Mat3::of(T(0, 0), T(0, 1), T(0, 2), T(1, 0), T(1, 1), T(1, 2), T(2, 0), T(2, 1), T(2, 2))};
}
}  // namespace truepose::python

namespace nanobind::detail {
/// Numbers of a new numpy array, by rows.
inline double* new_array(object& array, const nanobind::tuple& shape) {
  array = module_::import_("numpy").attr("empty")(shape, "double");
  return cast<ndarray<double, c_contig, device::cpu>>(array).data();
}

template <>
struct type_caster<truepose::RowMatrix> {
  using Array = ndarray<const double, ndim<2>, c_contig, device::cpu>;
  NB_TYPE_CASTER(truepose::RowMatrix, make_caster<Array>::Name)

  bool from_python(handle from, std::uint8_t flags, cleanup_list* cleanup) noexcept {
    make_caster<Array> caster;
    if (!caster.from_python(from, flags, cleanup)) return false;
    value = {static_cast<int>(caster.value.shape(0)), static_cast<int>(caster.value.shape(1)),
             caster.value.data()};
    return true;
  }
  static handle from_cpp(const truepose::RowMatrix& A, rv_policy, cleanup_list*) {
    object array;
    std::ranges::copy(A, new_array(array, make_tuple(A.rows(), A.cols())));
    return array.release();
  }
};

/// As homogeneous matrix, 4×4.
template <>
struct type_caster<truepose::Frame> {
  using Matrix = make_caster<truepose::RowMatrix>;
  NB_TYPE_CASTER(truepose::Frame, Matrix::Name)

  bool from_python(handle from, std::uint8_t flags, cleanup_list* cleanup) noexcept {
    Matrix T;
    if (!T.from_python(from, flags, cleanup)) return false;
    value = truepose::python::frame_of(T.value);
    return true;
  }
  static handle from_cpp(const truepose::Frame& frame, rv_policy policy, cleanup_list* cleanup) {
    truepose::RowMatrix T = truepose::RowMatrix::identity(4);
    for (int k = 0; k < 12; ++k)
      T(k / 4, k % 4) = k % 4 < 3 ? frame.R(k / 4, k % 4) : frame.t[k / 4];
    return Matrix::from_cpp(T, policy, cleanup);
  }
};
}  // namespace nanobind::detail
