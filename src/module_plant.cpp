// What another plant needs of the core: its readings, its setpoints, and the motion to compare
// with. No mathematics.
#include <nanobind/eigen/dense.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/tuple.h>

#include "arrays.hpp"
#include "truepose/control/trajectory.hpp"
#include "truepose/full/rkm.hpp"
#include "truepose/offline/plant.hpp"

namespace truepose::python {
namespace {

/// Exact readings of a mechanism that stands at this pose with these motors and arms.
auto readings(const Robot& robot, const Vec3& D, const Mat3& R,
              const std::array<double, kMaxBars>& psi, double theta, const Joint& motor,
              const Joint& arm) {
  FullPose pose;
  pose.D = D, pose.R = R, pose.psi = psi, pose.theta = theta;
  Extended q_e{};
  const Outcome outcome = with_mobility(robot.mobility, [&](auto mobility) {
    return read_standing<mobility()>(robot, pose, motor, arm, q_e);
  });
  return nb::make_tuple(q_e, static_cast<int>(outcome.status));
}

/// Coordinates of the nacelle's frame, and back.
auto coordinates(const Robot& robot, const Vec3& D, const Mat3& R) {
  return with_mobility(robot.mobility, [&](auto mobility) {
    Pose pose;
    pose.D = D, pose.R = R, pose.theta = theta_of(R, 0);
    return to_coordinates<mobility()>(pose);
  });
}
auto frame(const Robot& robot, const Joint& x) {
  return with_mobility(robot.mobility, [&](auto mobility) {
    const Pose pose = to_pose<mobility()>(x);
    return nb::make_tuple(pose.D, pose.R);
  });
}

/// Setpoint at a time of a straight move, quintic.
auto setpoint(const Robot& robot, const Joint& from, const Joint& to, double duration,
              double time) {
  return with_mobility(robot.mobility, [&](auto mobility) {
    const Setpoint at = quintic<mobility()>(from, to, duration, time);
    return nb::make_tuple(at.x, at.rate, at.acceleration);
  });
}

/// The reduced model's acceleration (a twist's) under motor torques.
auto acceleration(const Robot& robot, const Joint& x, const Joint& rate, const Joint& torque) {
  Joint result{};
  const Outcome outcome = with_mobility(robot.mobility, [&](auto mobility) {
    return forward_dynamics<mobility()>(robot, to_pose<mobility()>(x), rate, torque, result);
  });
  return nb::make_tuple(result, static_cast<int>(outcome.status));
}

/// Where the reduced model is after a time under constant torques, and its free twist.
auto advance_free(const Robot& robot, const Joint& x, const Joint& rate, const Joint& torque,
                  double duration, int steps) {
  Joint end{}, end_rate{};
  const Outcome outcome = with_mobility(robot.mobility, [&](auto mobility) {
    PlantState state{to_pose<mobility()>(x), rate};
    const Outcome result = advance<mobility()>(robot, torque, duration, steps, state);
    end = to_coordinates<mobility()>(state.pose);
    end_rate = state.rate;
    return result;
  });
  return nb::make_tuple(end, end_rate, static_cast<int>(outcome.status));
}

}  // namespace

void bind_plant(nb::module_& m) {
  m.def("readings", &readings);
  m.def("coordinates", &coordinates);
  m.def("frame", &frame);
  m.def("setpoint", &setpoint);
  m.def("acceleration", &acceleration);
  m.def("advance", &advance_free);
}

}  // namespace truepose::python
