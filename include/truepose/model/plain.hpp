// How does a robot hold vectors? As plain numbers: Eigen's own types cannot be copied byte by byte.
#pragma once

#include <Eigen/Core>
#include <array>

namespace truepose {

using Vec3 = Eigen::Vector3d;
using Mat3 = Eigen::Matrix3d;

/// The numbers of a Vec3 or a Mat3 (by columns), read and written as Eigen's by ().
template <class Value>
struct Plain {
  std::array<double, Value::SizeAtCompileTime> number{};

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
