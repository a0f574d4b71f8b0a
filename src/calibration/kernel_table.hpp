// A robot's functions at one level of the model, as offline code calls them.
#pragma once

#include "calibration/model_error.hpp"
#include "estimation/online_calibrator.hpp"

namespace truepose {
/// Generalised least squares at a pose, as Fusion, and the resulting weighted TEJ.
struct Fused : Fusion {
  ExtendedRows tej;
};

/// One mobility at one level. Arguments are as in the functions of the same names.
struct Kernels {
  Mobility mobility = Mobility::spatial;
  Level level = Level::ideal;
  int n = dof(mobility);

  Status fkm(const Robot& robot, const Joint& q, Pose& pose, Parasitic& rest) const {
    return motors_pose(level, robot, q, pose, rest);
  }
  Outcome linearise(const Robot& robot, const Pose& pose, Extended& q_e, PoseRows& H_x,
                    double* H_xi, Parasitic& rest) const {
    return truepose::linearise(level, robot, pose, q_e, H_x, H_xi, rest);
  }
  Outcome fuse(const Robot& robot, const Knowledge& known, const ReadingCovariance& C,
               const PoseRows& H_x, Fused& fused) const {
    const Outcome outcome = truepose::fuse(robot, known, C, H_x, fused);
    if (outcome) weighted_tej(robot, H_x, fused, fused.tej);
    return outcome;
  }
  Estimate estimate(const Robot& robot, const Knowledge& known, const Extended& q_e, Pose& pose,
                    double* work) const {
    return truepose::estimate(level, robot, known, q_e, pose, work);
  }
  Outcome observe(const Robot& drawn, const OnlineSettings& settings, const Extended& q_e,
                  OnlineState& state, Robot& robot, Pose& pose, double* memory) const {
    return truepose::observe(level, drawn, settings, q_e, state, robot, pose, memory);
  }
  /// Whether the full level is a separate model, so that the ideal one has a model error.
  bool errs() const { return paired(mobility); }
};

/// @param full  full level, where it is a separate model
inline Kernels kernels(Mobility mobility, bool full = false) {
  return {mobility, full && paired(mobility) ? Level::full : Level::ideal};
}
}  // namespace truepose
