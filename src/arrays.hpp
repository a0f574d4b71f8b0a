// How do numpy arrays reach the core? Rows of doubles in, freshly owned arrays out.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstring>
#include <initializer_list>
#include <memory>

#include "truepose/robot.hpp"
#include "truepose/status.hpp"

namespace truepose::python {

namespace nb = nanobind;

/// (N, width), C order; the facade has checked shapes and dtype.
using Rows = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

/// (width,), the same.
using Row = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

/// A numpy array that owns its memory.
template <class T>
class Owned {
 public:
  explicit Owned(std::initializer_list<std::size_t> shape) : rank_(shape.size()) {
    std::size_t size = 1, axis = 0;
    for (const std::size_t extent : shape) {
      shape_[axis++] = extent;
      size *= extent;
    }
    row_ = shape_[0] > 0 ? size / shape_[0] : 0;
    data_ = std::make_unique<T[]>(size);
  }

  /// Start of row i, whatever the shape of a row.
  T* operator[](std::size_t i) { return data_.get() + i * row_; }

  nb::ndarray<nb::numpy, T> release() {
    T* data = data_.release();
    nb::capsule owner(data, [](void* p) noexcept { delete[] static_cast<T*>(p); });
    return nb::ndarray<nb::numpy, T>(data, rank_, shape_.data(), owner);
  }

 private:
  std::unique_ptr<T[]> data_;
  std::array<std::size_t, 3> shape_{};
  std::size_t rank_, row_ = 0;
};

/// Status and guilty chain of every row.
struct Outcomes {
  explicit Outcomes(std::size_t count) : status({count}), chain({count}) {}
  void set(std::size_t i, Outcome outcome) {
    *status[i] = static_cast<int>(outcome.status);
    *chain[i] = outcome.chain;
  }
  Owned<int> status, chain;
};

/// Row i of an array as one of the core's fixed-capacity vectors.
template <class Vector>
inline Vector row(const Rows& rows, std::size_t i) {
  Vector result{};
  std::memcpy(result.data(), rows.data() + i * rows.shape(1), rows.shape(1) * sizeof(double));
  return result;
}

void bind_batch(nb::module_& module);
void bind_calibration(nb::module_& module);

}  // namespace truepose::python
