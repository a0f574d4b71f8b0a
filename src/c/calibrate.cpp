// Batch calibration for C: offline, unlike the rest of src/c.
#include "calibration/calibrate.hpp"

#include "c/model.hpp"
#include "truepose/calibrate.h"

using namespace truepose;

namespace truepose::c {
namespace {
Outcome sound(const Robot& robot, const truepose_knowledge& prior, const truepose_log& log) {
  if (log.rows < 1 || log.loss < 0 || log.loss > TRUEPOSE_LOSS_SQUARES) return Status::no_such_part;
  for (int k = 0; log.measured && k < dof(robot.mobility); ++k)
    if (!(log.measured_sigma[k] > 0)) return {Status::no_such_value, k};
  for (int k : range(robot.motors + robot.r))
    if (!(prior.sigma[k] > 0)) return {Status::no_such_value, k};
  return columns_exist(robot, prior, 1);
}

void fill(double* to, const auto& from) {
  if (to) std::copy(from.begin(), from.end(), to);
}

Outcome calibrate(const Robot& drawn, const truepose_knowledge& prior, const double* mean,
                  const truepose_log& log, truepose_calibration& result) {
  const int n = dof(drawn.mobility), p = prior.count;
  if (const Outcome outcome = sound(drawn, prior, log); !outcome) return outcome;
  std::vector<double> xi(parameter_count(drawn)), sigma;
  if (const Outcome outcome = drawn_parameters(drawn, xi.data()); !outcome) return outcome;
  for (int k = 0; mean && k < p; ++k) xi[prior.column[k]] = mean[k];
  const auto known = in<Knowledge>(&prior);
  ReadingLog readings;
  readings.count = log.rows, readings.q_e = log.readings;
  if (log.measured) {
    for (int k = 0; k < log.rows; ++k)
      sigma.insert(sigma.end(), log.measured_sigma, log.measured_sigma + n);
    readings.measured = log.measured, readings.measured_sigma = sigma.data();
  }
  CalibrationSettings settings;
  settings.loss = static_cast<Loss>(log.loss);
  const CalibrationResult fit =
      truepose::calibrate(level_of(drawn), drawn, known, xi, readings, settings);
  if (!fit.outcome) return fit.outcome;
  int redundancy = 0;
  double chi2 = 0;
  for (int k : range(log.rows))
    if (fit.redundancy[k] > 0 && fit.weight[k] > 0)
      redundancy += fit.redundancy[k], chi2 += fit.chi2[k];
  if (redundancy == 0) return Status::not_measured;
  result.iterations = fit.iterations, result.cost = fit.cost;
  result.rms = sqrt(chi2 / redundancy);
  result.used = int(std::count(fit.status.begin(), fit.status.end(), Status::ok));
  for (int k = 0; result.value && k < p; ++k) result.value[k] = fit.xi[prior.column[k]];
  if (result.covariance) copy_first(p * p, fit.covariance.data(), result.covariance);
  fill(result.chi2, fit.chi2);
  for (int k : range(log.rows)) {
    const bool found = fit.status[k] == Status::ok;
    if (result.status) result.status[k] = std::int32_t(fit.status[k]);
    if (!result.x) continue;
    const Coordinates x = to_coordinates(drawn.mobility, fit.pose[k]);
    for (int j : range(n)) result.x[k * n + j] = found ? x[j] : NAN;
  }
  return fit.outcome;
}
}  // namespace
}  // namespace truepose::c

using namespace truepose::c;

extern "C" {
truepose_outcome truepose_calibrate(const truepose_model* drawn, const truepose_knowledge* prior,
                                    const double* mean, const truepose_log* log,
                                    truepose_calibration* result) {
  return result->outcome = with(drawn)(
             [&](const Robot& robot) { return calibrate(robot, *prior, mean, *log, *result); });
}

truepose_outcome truepose_with_parameters(const truepose_model* drawn, int32_t count,
                                          const int32_t* column, const double* value,
                                          truepose_model* model, size_t size) {
  return with(drawn)([&](const Robot& robot) -> Outcome {
    std::vector<double> xi(parameter_count(robot));
    if (const Outcome outcome = drawn_parameters(robot, xi.data()); !outcome) return outcome;
    for (int k : range(count)) {
      if (column[k] < 0 || column[k] >= int(xi.size())) return {Status::no_such_part, k};
      xi[column[k]] = value[k];
    }
    Robot changed = robot;
    if (const Outcome outcome = set_parameters(robot, xi.data(), changed); !outcome) return outcome;
    return begun({}, model, size, [&](Model& made) { made.robot = changed; });
  });
}
}
