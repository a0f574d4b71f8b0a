// Conversion of numpy arrays: rows of doubles in, newly owned arrays out.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <functional>
#include <numeric>
#include <type_traits>
#include <utility>
#include <vector>

#include "mechanism/robot.hpp"
#include "truepose/status.hpp"

namespace truepose::python {
/// Copies an array's numbers, in the order of its rows; the rest of the capacity is 0.
/// @return false: no numbers, or more than `capacity`
bool take_numbers(nanobind::handle from, double* to, std::size_t capacity) noexcept;
}  // namespace truepose::python

namespace nanobind::detail {
/// An array of fixed capacity from anything that numpy takes for one, and as a numpy array.
template <class T, std::size_t N>
struct type_caster<std::array<T, N>> {
  using Array = std::array<T, N>;
  NB_TYPE_CASTER(Array, const_name("numpy.typing.NDArray"))

  bool from_python(handle from, std::uint8_t, cleanup_list*) noexcept {
    double numbers[N];
    const bool all = truepose::python::take_numbers(from, numbers, N);
    std::copy_n(numbers, all ? N : 0, value.begin());
    return all;
  }
  static handle from_cpp(const Array& array, rv_policy, cleanup_list*) noexcept {
    constexpr const char* dtype = std::is_integral_v<T> ? "intc" : "double";
    return module_::import_("numpy")
        .attr("array")(cast(std::vector<T>(array.begin(), array.end())), dtype)
        .release();
  }
};
}  // namespace nanobind::detail

namespace truepose::python {
namespace nb = nanobind;

/// (N, width), C order; the facade checks shapes and dtype.
using Rows = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

/// (width,), the same.
using Row = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

/// Extents of an array; the first is the number of rows.
using Shape = std::vector<std::size_t>;

/// A new numpy array, uninitialised: its creator fills it. numpy requests huge pages, without which
/// the first access to a large result takes longer than its computation.
template <class T>
class Owned {
 public:
  explicit Owned(const Shape& shape)
      : width(
            std::accumulate(shape.begin() + 1, shape.end(), std::size_t{1}, std::multiplies<>())) {
    nb::list extents;
    for (const std::size_t extent : shape) extents.append(extent);
    constexpr const char* dtype = std::is_same_v<T, bool>  ? "bool"
                                  : std::is_same_v<T, int> ? "intc"
                                                           : "double";
    array_ = nb::module_::import_("numpy").attr("empty")(nb::tuple(extents), dtype);
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

/// The same, filled with a vector's values.
template <class T>
nb::object owned(const std::vector<T>& values) {
  Owned<T> array({values.size()});
  std::copy(values.begin(), values.end(), array[0]);
  return array.release();
}

/// A tuple of finished arrays.
template <class... T>
nb::tuple together(Owned<T>&... arrays) {
  return nb::make_tuple(arrays.release()...);
}

/// Status and faulty chain of every row.
struct Outcomes {
  explicit Outcomes(std::size_t count) : status({count}), chain({count}) {}
  void set(std::size_t i, Outcome outcome) {
    *status[i] = static_cast<int>(outcome.status);
    *chain[i] = outcome.chain;
  }
  Owned<int> status, chain;
};

/// The same of one answer, behind its values.
template <class... T>
nb::tuple answered(Outcome outcome, const T&... values) {
  return nb::make_tuple(values..., static_cast<int>(outcome.status), outcome.chain);
}

/// Row i of an array as one of the core's fixed-capacity vectors.
template <class Vector>
inline Vector row(const Rows& rows, std::size_t i) {
  Vector result{};
  const std::size_t width = rows.shape(1) * sizeof(double);
  std::memcpy(result.data(), rows.data() + i * rows.shape(1), std::min(width, sizeof result));
  return result;
}

void bind_structs(nb::module_& module);
void bind_rows(nb::module_& module);
void bind_control(nb::module_& module);
void bind_simulation(nb::module_& module);
void bind_calibration(nb::module_& module);
void bind_safety(nb::module_& module);
}  // namespace truepose::python
