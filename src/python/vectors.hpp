// Vectors and matrices of space as numpy arrays, copied.
#pragma once

#include <nanobind/eigen/dense.h>
#include <nanobind/nanobind.h>

#include "math/vec3.hpp"

namespace nanobind::detail {
template <class Numbers, int columns>
struct SpaceCaster {
  using Dense = Eigen::Matrix<truepose::Real, 3, columns>;
  using Caster = make_caster<Dense>;
  NB_TYPE_CASTER(Numbers, Caster::Name)

  bool from_python(handle from, std::uint8_t flags, cleanup_list* cleanup) noexcept {
    Caster caster;
    if (!caster.from_python(from, flags, cleanup)) return false;
    Eigen::Map<Dense>(value.data()) = caster.operator cast_t<Dense&>();
    return true;
  }
  static handle from_cpp(const Numbers& numbers, rv_policy, cleanup_list* cleanup) noexcept {
    return Caster::from_cpp(Dense(Eigen::Map<const Dense>(numbers.data())), rv_policy::copy,
                            cleanup);
  }
};
template <>
struct type_caster<truepose::Vec3> : SpaceCaster<truepose::Vec3, 1> {};
template <>
struct type_caster<truepose::Mat3> : SpaceCaster<truepose::Mat3, 3> {};
}  // namespace nanobind::detail
