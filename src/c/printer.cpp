// The C interface of printers: settings to the core's, JSON out.
#include "truepose/printers.h"

#include <cstring>

#include "truepose/printers/answer.hpp"

int truepose_printer(const char* text, size_t length, const truepose_printer_options* options,
                     char* json, size_t capacity) {
  using namespace truepose::printers;
  Request request;
  if (options) {
    request.arm = kMm * options->arm_mm;
    request.probe_radius = options->probe_radius_mm;
    request.next = options->next >= 1 ? int(std::min(options->next, 1000.0)) : 0;
    double sigma[TRUEPOSE_PRINTER_SIGMAS];
    for (int k = 0; k < TRUEPOSE_PRINTER_SIGMAS; ++k)
      sigma[k] = options->sigma[k] * (k == TRUEPOSE_PRINTER_ANGLE       ? kDegree
                                      : k == TRUEPOSE_PRINTER_SHRINKAGE ? 0.01
                                                                        : kMm);
    request.assumed.set(sigma);
  }
  const std::string answered = answer({text, length}, request);
  if (answered.size() <= capacity) std::memcpy(json, answered.data(), answered.size());
  return int(answered.size());
}
