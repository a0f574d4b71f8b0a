// Vectors as plain numbers: Eigen's own types cannot be copied byte by byte.
#pragma once

#include <Eigen/Core>
#include <array>

#include "truepose/math/real.hpp"

namespace truepose {
using Vec3 = Eigen::Matrix<Real, 3, 1>;
using Mat3 = Eigen::Matrix<Real, 3, 3>;

/// The numbers of a Vec3 or a Mat3 (by columns), read and written as Eigen's type by ().
template <class Value>
struct Plain {
  std::array<Real, Value::SizeAtCompileTime> number{};

  Plain() = default;
  template <class Derived>
  Plain(const Eigen::EigenBase<Derived>& value) {
    (*this)() = value.derived();
  }
  Eigen::Map<Value> operator()() { return Eigen::Map<Value>(number.data()); }
  Eigen::Map<const Value> operator()() const { return Eigen::Map<const Value>(number.data()); }
  operator Value() const { return (*this)(); }
};
}  // namespace truepose
