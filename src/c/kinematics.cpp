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

Mat3 matrix(const truepose_real* rows) {
  Mat3 R;
  for (int k = 0; k < 9; ++k) R(k / 3, k % 3) = rows[k];
  return R;
}
void by_rows(const Mat3& R, truepose_real* rows) {
  for (int k = 0; k < 9; ++k) rows[k] = R(k / 3, k % 3);
}
/// The largest entry; NaN where one is.
template <class Numbers>
Real largest(const Numbers& of) {
  Real most = 0;
  for (std::size_t k = 0; k < sizeof of / sizeof(Real); ++k)
    most = std::fabs(of.data()[k]) <= most ? most : std::fabs(of.data()[k]);
  return most;
}
Status rotation_status(const Mat3& R) {
  const Mat3 off = R * R.transpose() - Mat3::Identity();
  if (largest(off) < kRotation && R.col(0).cross(R.col(1)).dot(R.col(2)) > 0) return Status::ok;
  return R.allFinite() ? Status::no_such_value : Status::not_finite;
}

Pose place_of(const Robot& robot, const Coordinates& x) {
  return placed(robot, to_pose(robot.mobility, x));
}

/// Converts the pose of a rigid body; its numbers must be finite, its matrix a rotation.
Outcome body(const truepose_pose& pose, Pose& at) {
  at.R = matrix(pose.rotation);
  at.D = Vec3(pose.position[0], pose.position[1], pose.position[2]);
  return {at.D.allFinite() ? rotation_status(at.R) : Status::not_finite, -1};
}

/// Converts a pose to coordinates if the mobility allows it. @param x  in: guess; out
Outcome coordinates(const Robot& robot, const truepose_pose& pose, Coordinates& x) {
  Pose at;
  const Outcome sound = body(pose, at);
  if (!sound) return sound;
  if (turns_about_z(robot.mobility)) {
    const Real near = x[dof(robot.mobility) - 1];
    at.theta = theta_of(at.R, std::isfinite(near) ? near : 0);
  }
  Pose own = at;
  if (is_rotational(robot.mobility)) {
    own = to_pose(robot.mobility, all_finite(x, dof(robot.mobility)) ? x : robot.home);
    angles_of(robot, at, own);
  }
  const Coordinates found = to_coordinates(robot.mobility, own);
  const Pose again = place_of(robot, found);
  if (!(largest(again.R - at.R) < kRotation && largest(again.D - at.D) < kRotation))
    return {Status::no_such_value, -1};
  x = found;
  return {};
}

void to_c(const Robot& robot, const Coordinates& x, truepose_pose* pose) {
  const Pose at = place_of(robot, x);
  std::copy_n(at.D.data(), 3, pose->position);
  by_rows(at.R, pose->rotation);
}

Outcome rates(const Robot& robot, const truepose_real* x, JointMatrix& J) {
  const auto at = values<Coordinates>(x);
  return robot.rod_by_rod() ? jacobian_full(robot, at, J) : jacobian(robot, at, J);
}

/// Converts torques from motors to joints, by Kᵀ, or back, by Jᵀ.
template <class From, class To>
Outcome mapped(const Robot& robot, const truepose_real* x, const truepose_real* from,
               truepose_real* to) {
  constexpr bool kToJoints = std::is_same_v<To, Coordinates>;
  const auto given = values<From>(from);
  const int n = dof(robot.mobility), m = robot.motors;
  if (!all_finite(given, kToJoints ? m : n)) return {Status::not_finite, -1};
  JointMatrix J{};
  const Outcome outcome = rates(robot, x, J);
  if (!outcome) return outcome;
  Square by{}, inverse{};  // Jᵀ, and its inverse, Kᵀ
  Unknowns size{};
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < m; ++j) by[j][i] = J[i][j], size[i] += J[i][j] * J[i][j];
  if (kToJoints && !invert(m, n, by, size, 0, inverse)) return {Status::singular, -1};
  To result{};
  for (int i = 0; i < (kToJoints ? n : m); ++i)
    result[i] = sum_of(kToJoints ? m : n,
                       [&](int j) { return (kToJoints ? inverse : by)[i][j] * given[j]; });
  give(result, to);
  return outcome;
}

Outcome motors(const Robot& robot, const Coordinates& x, truepose_real* q) {
  Joint found{};
  const Outcome outcome =
      robot.rod_by_rod() ? command_full(robot, x, found) : command(robot, x, found);
  if (outcome) give(found, q);
  return outcome;
}

/// The same for a pose, with its conditioning.
Outcome motors(const Robot& robot, const truepose_pose& pose, truepose_real* q,
               truepose_real* conditioned) {
  Joint found{};
  Outcome outcome;
  if (robot.mobility == Mobility::spatial && !robot.rod_by_rod()) {  // any pose is feasible
    Pose at;
    outcome = body(pose, at);
    if (outcome) outcome = command(robot, at, found, conditioned);
  } else {
    Coordinates x = robot.home;
    outcome = coordinates(robot, pose, x);
    if (outcome) outcome = motors(robot, x, found.data());
    Joint serial{};
    Real parallel = 0;
    if (outcome && conditioned) outcome = conditioning(robot, x, parallel, serial);
    if (outcome && conditioned)
      *conditioned =
          std::min(parallel, *std::min_element(serial.begin(), serial.begin() + robot.motors));
  }
  if (outcome) give(found, q);
  return outcome;
}

FkmResult pose_of(const Robot& robot, const truepose_real* q, std::int32_t cap, Coordinates& x) {
  if (cap < 1 || cap > kFkmCap) return {{Status::no_such_value, -1}};
  const auto motors = values<Joint>(q);
  return robot.rod_by_rod() ? fkm_full(robot, motors, x, cap) : fkm(robot, motors, x, cap);
}
/// f(robot) of a loaded model, else `unfinished`.
template <class F>
truepose_fkm_result searched(const truepose_model* model, F&& f) {
  const Robot* robot = robot_of(model);
  return converted<truepose_fkm_result>(robot ? f(*robot) : FkmResult{kUnfinished});
}
}  // namespace
}  // namespace truepose::c

extern "C" {
truepose_outcome truepose_pose_of(const truepose_model* model, const truepose_real* x,
                                  truepose_pose* pose) {
  return c::asked(model, [&](const Robot& robot) -> Outcome {
    const auto at = c::values<Coordinates>(x);
    if (!all_finite(at, dof(robot.mobility))) return {Status::not_finite, -1};
    c::to_c(robot, at, pose);
    return {};
  });
}

truepose_outcome truepose_coordinates_of(const truepose_model* model, const truepose_pose* pose,
                                         truepose_real* x) {
  return c::asked(model, [&](const Robot& robot) {
    auto at = c::values<Coordinates>(x);
    const Outcome outcome = c::coordinates(robot, *pose, at);
    if (outcome) c::give(at, x);
    return outcome;
  });
}

truepose_outcome truepose_from_roll_pitch_yaw(const truepose_real* angles,
                                              truepose_real* rotation) {
  const auto from = c::values<RollPitchYaw>(angles);
  if (!all_finite(from, 3)) return c::answer(Status::not_finite);
  c::by_rows(from_roll_pitch_yaw(from), rotation);
  return c::answer(Outcome{});
}

truepose_outcome truepose_to_roll_pitch_yaw(const truepose_real* rotation, truepose_real* angles) {
  const Mat3 R = c::matrix(rotation);
  const auto near = c::values<RollPitchYaw>(angles);
  Status status = c::rotation_status(R);
  if (!all_finite(near, 3)) status = Status::not_finite;
  if (status == Status::ok) c::give(to_roll_pitch_yaw(R, near), angles);
  return c::answer(status);
}

truepose_outcome truepose_ikm(const truepose_model* model, const truepose_real* x,
                              truepose_real* q) {
  return c::asked(
      model, [&](const Robot& robot) { return c::motors(robot, c::values<Coordinates>(x), q); });
}

truepose_outcome truepose_ikm_pose(const truepose_model* model, const truepose_pose* pose,
                                   truepose_real* q, truepose_real* conditioned) {
  return c::asked(model,
                  [&](const Robot& robot) { return c::motors(robot, *pose, q, conditioned); });
}

truepose_fkm_result truepose_fkm(const truepose_model* model, const truepose_real* q, int32_t cap,
                                 truepose_real* x) {
  return c::searched(model, [&](const Robot& robot) {
    auto at = c::values<Coordinates>(x);
    const FkmResult result = c::pose_of(robot, q, cap, at);
    if (result) c::give(at, x);
    return result;
  });
}

truepose_fkm_result truepose_fkm_pose(const truepose_model* model, const truepose_real* q,
                                      int32_t cap, truepose_pose* pose) {
  return c::searched(model, [&](const Robot& robot) -> FkmResult {
    Coordinates x = robot.home;
    const Outcome near = c::coordinates(robot, *pose, x);
    if (!near) return {near};
    const FkmResult result = c::pose_of(robot, q, cap, x);
    if (result) c::to_c(robot, x, pose);
    return result;
  });
}

truepose_outcome truepose_readings(const truepose_model* model, const truepose_real* x,
                                   truepose_real* q_e) {
  return c::asked(model, [&](const Robot& robot) {
    const auto at = c::values<Coordinates>(x);
    const bool full = robot.rod_by_rod();
    Joint q{};
    Reading r{};
    Outcome outcome = full ? ikm_full(robot, at, q) : ikm(robot, at, q);
    if (outcome.status == Status::joint_limit) outcome = {};  // q is computed
    if (outcome) outcome = full ? rkm_full(robot, at, r) : rkm(robot, at, r);
    if (outcome) {
      std::fill_n(q_e, kMaxReadings, 0);
      std::copy_n(q.begin(), robot.motors, q_e);
      std::copy_n(r.begin(), robot.r, q_e + robot.motors);
    }
    return outcome;
  });
}

truepose_outcome truepose_jacobian(const truepose_model* model, const truepose_real* x,
                                   truepose_real* J) {
  return c::asked(model, [&](const Robot& robot) {
    JointMatrix found{};
    const Outcome outcome = c::rates(robot, x, found);
    if (outcome) c::give(found, J);
    return outcome;
  });
}

truepose_outcome truepose_gyro(const truepose_model* model, const truepose_real* x,
                               truepose_real* W) {
  return c::asked(model, [&](const Robot& robot) {
    GyroRows found{};
    const Outcome outcome = gyro(robot, c::values<Coordinates>(x), found);
    if (outcome) c::give(found, W);
    return outcome;
  });
}

truepose_outcome truepose_joint_torque(const truepose_model* model, const truepose_real* x,
                                       const truepose_real* torque, truepose_real* joint) {
  return c::asked(model, [&](const Robot& robot) {
    return c::mapped<Joint, Coordinates>(robot, x, torque, joint);
  });
}

truepose_outcome truepose_motor_torque(const truepose_model* model, const truepose_real* x,
                                       const truepose_real* joint, truepose_real* torque) {
  return c::asked(model, [&](const Robot& robot) {
    return c::mapped<Coordinates, Joint>(robot, x, joint, torque);
  });
}

truepose_outcome truepose_conditioning(const truepose_model* model, const truepose_real* x,
                                       truepose_real* parallel, truepose_real* serial) {
  return c::asked(model, [&](const Robot& robot) {
    Real type2 = 0;
    Joint type1{};
    const Outcome outcome = conditioning(robot, c::values<Coordinates>(x), type2, type1);
    if (outcome) {
      *parallel = type2;
      c::give(type1, serial);
    }
    return outcome;
  });
}

truepose_outcome truepose_tej(const truepose_model* model, const truepose_real* x,
                              truepose_real band, truepose_real* tej_rows) {
  return c::asked(model, [&](const Robot& robot) {
    ExtendedColumns M{};
    ExtendedRows M_plus{};
    const Outcome outcome = tej(robot, c::values<Coordinates>(x), M, M_plus, band);
    if (outcome) c::give(M_plus, tej_rows);
    return outcome;
  });
}
}
