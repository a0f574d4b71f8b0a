// Poses and kinematics for C.
#include "c/model.hpp"
#include "math/roll_pitch_yaw.hpp"
#include "math/square.hpp"
#include "mechanism/angles_of.hpp"
#include "mechanism/gyro.hpp"

using namespace truepose;

namespace truepose::c {
namespace {
constexpr Real kRotation = by_precision(1e-6, 1e-5);  ///< tolerance of R Rᵀ = 1

/// Of numbers by rows; the core has them by columns.
Mat3 matrix(const truepose_real* rows) { return in<Mat3>(rows).transpose(); }
void by_rows(const Mat3& R, truepose_real* rows) { out(R.transpose(), rows); }

/// Whether all entries are within the tolerance of a rotation.
bool vanishes(const auto& of) {
  for (std::size_t k = 0; k < sizeof of / sizeof(Real); ++k)
    if (!(fabs(of.data()[k]) < kRotation)) return false;
  return true;
}
Outcome rotates(const Mat3& R) {
  if (vanishes(R * R.transpose() - Mat3::Identity()) && R.col(0).cross(R.col(1)).dot(R.col(2)) > 0)
    return {};
  return {R.allFinite() ? Status::no_such_value : Status::not_finite};
}

Pose place_of(const Robot& robot, const Coordinates& x) {
  return placed(robot, to_pose(robot.mobility, x));
}

/// Converts the pose of a rigid body; its numbers must be finite, its matrix a rotation.
Outcome body(const truepose_pose& pose, Pose& at) {
  at.R = matrix(pose.rotation);
  at.D = in<Vec3>(pose.position);
  return at.D.allFinite() ? rotates(at.R) : Outcome{Status::not_finite};
}

/// Converts a pose to coordinates if the mobility allows it. @param x  in: guess; out
Outcome coordinates(const Robot& robot, const truepose_pose& pose, Coordinates& x) {
  Pose at;
  const Outcome sound = body(pose, at);
  if (!sound) return sound;
  const Coordinates found = coordinates_of(robot, at, x);
  const Pose again = place_of(robot, found);
  if (!vanishes(again.R - at.R) || !vanishes(again.D - at.D)) return Status::no_such_value;
  x = found;
  return {};
}

void to_c(const Robot& robot, const Coordinates& x, truepose_pose* pose) {
  const Pose at = place_of(robot, x);
  out(at.D, pose->position);
  by_rows(at.R, pose->rotation);
}

/// Converts torques from motors to joints, by Kᵀ, or back, by Jᵀ.
template <class From, class To>
Outcome mapped(const Robot& robot, const Coordinates& x, const From& given, To& result) {
  constexpr bool kToJoints = std::is_same_v<To, Coordinates>;
  const int n = dof(robot.mobility), m = robot.motors;
  if (!all_finite(given, kToJoints ? m : n)) return Status::not_finite;
  JointMatrix J{};
  const Outcome outcome = jacobian(level_of(robot), robot, x, J);
  if (!outcome) return outcome;
  Square by{}, inverse{};  // Jᵀ, and its inverse, Kᵀ
  Unknowns size{};
  for (int i : range(n))
    for (int j : range(m)) by[j][i] = J[i][j], size[i] += J[i][j] * J[i][j];
  if (kToJoints && !invert(m, n, by, size, inverse)) return Status::singular;
  for (int i = 0; i < (kToJoints ? n : m); ++i)
    result[i] = sum_of(kToJoints ? m : n,
                       [&](int j) { return (kToJoints ? inverse : by)[i][j] * given[j]; });
  return outcome;
}

FkmResult pose_of(const Robot& robot, const Joint& q, std::int32_t cap, Coordinates& x) {
  if (cap < 1 || cap > kFkmCap) return {{Status::no_such_value}};
  return fkm(level_of(robot), robot, q, x, cap);
}
}  // namespace
}  // namespace truepose::c

using namespace truepose::c;

extern "C" {
truepose_outcome truepose_pose_of(const truepose_model* model, const truepose_real* x,
                                  truepose_pose* pose) {
  return with(model, x)([&](const Robot& robot, const Coordinates& at) -> Outcome {
    if (!all_finite(at, dof(robot.mobility))) return Status::not_finite;
    to_c(robot, at, pose);
    return {};
  });
}

truepose_outcome truepose_coordinates_of(const truepose_model* model, const truepose_pose* pose,
                                         truepose_real* x) {
  return with(model, pose, Both{x})(coordinates);
}

truepose_outcome truepose_from_roll_pitch_yaw(const truepose_real* angles,
                                              truepose_real* rotation) {
  return with(angles)([&](const RollPitchYaw& from) -> Outcome {
    if (!all_finite(from, 3)) return Status::not_finite;
    by_rows(from_roll_pitch_yaw(from), rotation);
    return {};
  });
}

truepose_outcome truepose_to_roll_pitch_yaw(const truepose_real* rotation, truepose_real* angles) {
  return with(Both{angles})([&](RollPitchYaw& near) -> Outcome {
    const Mat3 R = matrix(rotation);
    if (!all_finite(near, 3)) return Status::not_finite;
    const Outcome outcome = rotates(R);
    if (outcome) near = to_roll_pitch_yaw(R, near);
    return outcome;
  });
}

truepose_outcome truepose_ikm(const truepose_model* model, const truepose_real* x,
                              truepose_real* q) {
  return with(model, x, q)([](const Robot& robot, const Coordinates& at, Joint& found) {
    return command(level_of(robot), robot, at, found);
  });
}

truepose_outcome truepose_ikm_pose(const truepose_model* model, const truepose_pose* pose,
                                   truepose_real* q, truepose_real* conditioned) {
  return with(model, q)([&](const Robot& robot, Joint& found) {
    Pose at;
    Coordinates x = robot.home;
    const bool any = robot.mobility == Mobility::spatial;  // any pose is feasible
    const Outcome outcome = any ? body(*pose, at) : coordinates(robot, *pose, x);
    if (!any) at = to_pose(robot.mobility, x);
    return outcome ? command(level_of(robot), robot, at, found, conditioned) : outcome;
  });
}

truepose_fkm_result truepose_fkm(const truepose_model* model, const truepose_real* q, int32_t cap,
                                 truepose_real* x) {
  return with(model, q, cap, Both{x})(pose_of);
}

truepose_fkm_result truepose_fkm_pose(const truepose_model* model, const truepose_real* q,
                                      int32_t cap, truepose_pose* pose) {
  return with(model, q)([&](const Robot& robot, const Joint& at) -> FkmResult {
    Coordinates x = robot.home;
    const Outcome near = coordinates(robot, *pose, x);
    if (!near) return {near};
    const FkmResult result = pose_of(robot, at, cap, x);
    if (result) to_c(robot, x, pose);
    return result;
  });
}

truepose_outcome truepose_readings(const truepose_model* model, const truepose_real* x,
                                   truepose_real* q_e) {
  return with(model, x, q_e)([](const Robot& robot, const Coordinates& at, Extended& found) {
    return extended(level_of(robot), robot, to_pose(robot.mobility, at), found);
  });
}

truepose_outcome truepose_jacobian(const truepose_model* model, const truepose_real* x,
                                   truepose_real* J) {
  return with(model, x, J)([](const Robot& robot, const Coordinates& at, JointMatrix& found) {
    return jacobian(level_of(robot), robot, at, found);
  });
}

truepose_outcome truepose_gyro(const truepose_model* model, const truepose_real* x,
                               truepose_real* W) {
  return with(model, x, W)(gyro);
}

truepose_outcome truepose_joint_torque(const truepose_model* model, const truepose_real* x,
                                       const truepose_real* torque, truepose_real* joint) {
  return with(model, x, torque, joint)(mapped<Joint, Coordinates>);
}

truepose_outcome truepose_motor_torque(const truepose_model* model, const truepose_real* x,
                                       const truepose_real* joint, truepose_real* torque) {
  return with(model, x, joint, torque)(mapped<Coordinates, Joint>);
}

truepose_outcome truepose_conditioning(const truepose_model* model, const truepose_real* x,
                                       truepose_real* parallel, truepose_real* serial) {
  return with(model, x, parallel, serial)(conditioning);
}

truepose_outcome truepose_tej(const truepose_model* model, const truepose_real* x,
                              truepose_real band, truepose_real* tej_rows) {
  return with(model, x,
              tej_rows)([&](const Robot& robot, const Coordinates& at, ExtendedRows& found) {
    ExtendedColumns M{};
    return tej(robot, at, M, found, band);
  });
}
}
