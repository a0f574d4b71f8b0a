// The C interface of printers: settings to the core's, JSON out.
#include "truepose/printers.h"

#include <cstring>

#include "truepose/printers/answer.hpp"

using namespace truepose::printers;

int truepose_printer(const char* text, size_t length, const truepose_printer_options* options,
                     char* json, size_t capacity) {
  Request request;
  if (options) {
    request.arm = kMm * options->arm_mm;
    request.probe_radius = options->probe_radius_mm;
    request.next = options->next >= 1 ? int(std::min(options->next, 1000.0)) : 0;
    request.heights_alone = options->heights_alone != 0;
    request.assumed = options->sigma;
  }
  const std::string answered = answer({text, length}, request);
  if (answered.size() <= capacity) std::memcpy(json, answered.data(), answered.size());
  return int(answered.size());
}

namespace {
Delta delta_of(int rotary, const double* step) { return {rotary != 0, Vector3(step)}; }
Vector parameters(const Delta& delta, const double* p) {
  return Eigen::Map<const Vector>(p, delta.count());
}
}  // namespace

void truepose_printer_positions(int rotary, size_t count, const double* step, const double* p,
                                const double* steps, double* x, double* slopes) {
  const Delta delta = delta_of(rotary, step);
  const Vector of = parameters(delta, p);
  using Rows = Eigen::Matrix<double, 3, Eigen::Dynamic, Eigen::RowMajor>;
  Matrix J;
  for (size_t k = 0; k < count; ++k) {
    Eigen::Map<Vector3>(x + 3 * k) = delta.position(of, Vector3(steps + 3 * k), &J);
    Eigen::Map<Rows>(slopes + 3 * k * size_t(delta.count()), 3, delta.count()) = J;
  }
}

void truepose_printer_steps(int rotary, size_t count, const double* step, const double* p,
                            const double* x, double* steps) {
  const Delta delta = delta_of(rotary, step);
  const Vector of = parameters(delta, p);
  for (size_t k = 0; k < count; ++k)
    Eigen::Map<Vector3>(steps + 3 * k) = delta.steps(of, Vector3(x + 3 * k));
}
