// Conversion of numpy arrays: the core's arrays and matrices from them, and as newly owned ones.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/vector.h>

#include <functional>
#include <numeric>

#include "calibration/dense.hpp"
#include "calibration/registration.hpp"
#include "mechanism/robot.hpp"

namespace truepose::python {
namespace nb = nanobind;

/// Doubles in C order.
template <class... Shape>
using Numbers = nb::ndarray<const double, Shape..., nb::c_contig, nb::device::cpu>;

/// (N, width); the facade checks shapes and dtype.
using Rows = Numbers<nb::ndim<2>>;

/// A function of numpy.
inline nb::object numpy(const char* name) { return nb::module_::import_("numpy").attr(name); }

/// Extents of an array; the first is the number of rows.
using Shape = std::vector<std::size_t>;
inline std::size_t numbers(const Shape& shape) {
  return std::accumulate(shape.begin(), shape.end(), std::size_t{1}, std::multiplies<>());
}

/// A new numpy array, uninitialised: its creator fills it. numpy requests huge pages, without which
/// the first access to a large result takes longer than its computation.
template <class T>
class Owned {
 public:
  explicit Owned(const Shape& shape) : width(numbers({shape.begin() + 1, shape.end()})) {
    array_ = numpy("empty")(shape, sizeof(T) == 1 ? "bool" : sizeof(T) == 4 ? "intc" : "double");
    data_ = nb::cast<nb::ndarray<T, nb::c_contig, nb::device::cpu>>(array_).data();
  }

  /// Start of row i, whatever the shape of a row.
  T* operator[](std::size_t i) { return data_ + i * width; }

  nb::object release() { return std::move(array_); }

  const std::size_t width;  ///< numbers in a row

 private:
  nb::object array_;
  T* data_ = nullptr;
};

/// A copy of a range of numbers as an array, of its length by default.
template <class Range>
nb::object owned(const Range& from, Shape shape = {}) {
  if (shape.empty()) shape = {std::ranges::size(from)};
  Owned<std::remove_cvref_t<decltype(*from.data())>> array(shape);
  std::ranges::copy(from, array[0]);
  return array.release();
}
inline nb::object owned(const RowMatrix& from) {
  return owned(from, {std::size_t(from.rows()), std::size_t(from.cols())});
}

/// A frame's homogeneous matrix by rows, and back.
inline std::array<double, 16> numbers_of(const Frame& from) {
  std::array<double, 16> T{};
  for (int k : range(12)) T[k] = k % 4 < 3 ? from.R(k / 4, k % 4) : from.t[k / 4];
  T[15] = 1;
  return T;
}
inline Frame frame_of(const double* T) {
  return {{T[3], T[7], T[11]}, Mat3::of(T[0], T[1], T[2], T[4], T[5], T[6], T[8], T[9], T[10])};
}
inline nb::object owned(const Frame& from) { return owned(numbers_of(from), {4, 4}); }

/// Whether something is numbers for numpy, and all of them are taken in the order of their rows; of
/// a fixed capacity the rest is 0.
template <class Array>
bool taken(nb::handle from, Array& to) noexcept {
  try {
    if (from.is_none()) return false;
    const auto given = nb::cast<Numbers<>>(numpy("ascontiguousarray")(from, "double"));
    const std::size_t size = given.size();
    if constexpr (std::is_same_v<Array, RowMatrix>) {
      if (given.ndim() != 2) return false;
      to = {int(given.shape(0)), int(given.shape(1)), given.data()};
    } else if constexpr (std::is_same_v<Array, Frame>) {
      if (size != 16) return false;
      to = frame_of(given.data());
    } else if constexpr (requires { to.resize(size); }) {
      to.assign(given.data(), given.data() + size);
    } else {
      if (size > to.size()) return false;
      to.fill({});
      std::copy_n(given.data(), size, to.begin());
    }
    return true;
  } catch (const std::exception&) {
    return false;
  }
}
}  // namespace truepose::python

namespace nanobind::detail {
/// From anything that numpy takes for an array, and as a numpy array, copied.
template <class Array>
struct array_caster {
  NB_TYPE_CASTER(Array, const_name("numpy.typing.NDArray"))

  bool from_python(handle from, std::uint8_t, cleanup_list*) noexcept {
    return truepose::python::taken(from, value);
  }
  static handle from_cpp(const Array& array, rv_policy, cleanup_list*) {
    return truepose::python::owned(array).release();
  }
};
template <class T, std::size_t N>
struct type_caster<std::array<T, N>> : array_caster<std::array<T, N>> {};
template <>
struct type_caster<std::vector<double>> : array_caster<std::vector<double>> {};
template <>
struct type_caster<std::vector<int>> : array_caster<std::vector<int>> {};
template <>
struct type_caster<truepose::RowMatrix> : array_caster<truepose::RowMatrix> {};
template <>
struct type_caster<truepose::Frame> : array_caster<truepose::Frame> {};
}  // namespace nanobind::detail

namespace truepose::python {
/// The status and chain of an answer, behind its values.
template <class... T>
nb::tuple answered(Outcome outcome, const T&... values) {
  return nb::make_tuple(values..., int(outcome.status), outcome.chain);
}

/// Row i of an array; its only row is that of all.
inline const double* at_row(const Rows& rows, std::size_t i) {
  return rows.data() + (rows.shape(0) == 1 ? 0 : i * rows.shape(1));
}

/// The same as one of the core's fixed-capacity vectors.
template <class Vector>
Vector row(const Rows& rows, std::size_t i) {
  Vector result{};
  std::copy_n(at_row(rows, i), min(rows.shape(1), sizeof result / sizeof(double)), result.data());
  return result;
}

inline Level level(bool full) { return full ? Level::full : Level::ideal; }

void bind_structs(nb::module_& module);
void bind_rows(nb::module_& module);
void bind_control(nb::module_& module);
void bind_simulation(nb::module_& module);
void bind_calibration(nb::module_& module);
}  // namespace truepose::python
