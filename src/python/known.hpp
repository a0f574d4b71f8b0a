// Python's knowledge of a robot for the core, which holds pointers to arrays owned here.
#pragma once

#include <stdexcept>
#include <vector>

#include "calibration/line.hpp"
#include "control/law.hpp"
#include "python/arrays.hpp"
#include "python/matrices.hpp"

namespace truepose::python {
/// Knowledge that owns its arrays.
struct Known {
  std::vector<int> column;
  RowMatrix root;
  Extended sigma{};

  Known(std::vector<int> columns, RowMatrix lower, const std::vector<double>& sigmas)
      : column(std::move(columns)), root(std::move(lower)) {
    if (root.rows() != root.cols() || root.rows() != static_cast<int>(column.size()) ||
        sigmas.size() > sigma.size())
      throw std::invalid_argument(
          "one row and column for each parameter, one sigma for each reading");
    std::copy(sigmas.begin(), sigmas.end(), sigma.begin());
  }
  Knowledge view() const {
    return {static_cast<int>(column.size()), column.data(), root.data(), sigma};
  }
};

/// Influences at pose i: none, or row i of (N, (m + r) × count).
inline Influences influences_at(const Robot& robot, const Rows* influence, std::size_t i) {
  if (influence == nullptr) return {};
  const std::size_t width = influence->shape(1);
  return {static_cast<int>(width) / readings(robot), influence->data() + i * width};
}

/// Knowledge and work space of one thread for weighted laws; both optional.
class Weights {
 public:
  Weights(const Robot& robot, const Known* known) {
    if (known == nullptr) return;
    knowledge_ = known->view();
    work_.resize(estimate_work(robot, knowledge_.count));
    view_ = {&knowledge_, work_.data()};
  }
  Weights(const Weights&) = delete;
  Weights& operator=(const Weights&) = delete;
  const Weighing& view() const { return view_; }

 private:
  Knowledge knowledge_;
  std::vector<double> work_;
  Weighing view_;
};
}  // namespace truepose::python
