// Matrices of the core as numpy arrays, copied.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <algorithm>

#include "calibration/dense.hpp"

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
}  // namespace nanobind::detail
