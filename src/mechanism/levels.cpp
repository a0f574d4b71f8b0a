// Kinematics at a level of the model: one rod per chain, or every rod by itself.
#include "mechanism/levels.hpp"

namespace truepose {
namespace {
Outcome read(const Robot& robot, const Closure& at, Extended& q_e) {
  Reading values;
  SensorRows jr;
  const Outcome outcome = rkm(robot, at, values, jr);
  if (outcome) extend(robot, at.q(), values, q_e);
  return outcome;
}
Outcome read(const Robot& robot, const FullClosure& at, Extended& q_e) {
  return truepose::read(robot, at.built, at.at, at.pose.theta, q_e);
}

[[gnu::noinline]] FkmResult fkm_full(const Robot& robot, const Joint& q, Coordinates& x, int cap) {
  FullPose pose = to_full(to_pose(robot.mobility, x));
  FullClosure closure;
  const FkmResult result = fkm(robot, q, pose, closure, cap);
  x = to_coordinates(robot.mobility, pose);
  return result;
}

[[gnu::noinline]] Status motors_pose_full(const Robot& robot, const Joint& q, Pose& pose,
                                          Parasitic& rest) {
  FullPose full = to_full(pose);
  FullClosure closure;
  const int most = min(kFkmStart, rest.most(false));
  if (most < 1) return Status::not_converged;
  const FkmResult result = fkm(robot, q, full, closure, most, rest);
  const Status status = result.status;
  rest.take(result.iterations);
  if (status != Status::ok) return status;
  // D and θ are the coordinates; tilt and bars follow from them.
  pose = full;
  if (is_mechanism(robot.mobility)) {
    closure.note(stand(robot, closure.built, q, pose), rest);
    return status;
  }
  pose.R = turns_about_z(robot.mobility) ? rotation_z(pose.theta) : Mat3::Identity();
  if (Closure ideal; ikm(robot, pose, ideal))
    closure.note(stand(robot, closure.built, ideal.q(), pose), rest);
  return status;
}
}  // namespace

Outcome ikm(Level level, const Robot& robot, const Coordinates& x, Joint& q) {
  return closed(level, robot, to_pose(robot.mobility, x), [&](const auto& at) {
    q = at.q();
    return within_limits(robot, at.pose, q);
  });
}

FkmResult fkm(Level level, const Robot& robot, const Joint& q, Coordinates& x, int cap) {
  if (!robot.finished) return {{Status::unfinished}};
  if (by_engine(level, robot))
    return engine_closes(robot) ? fkm_full(robot, q, x, cap) : FkmResult{{Status::no_full_level}};
  Pose pose = to_pose(robot.mobility, x);
  const FkmResult result = fkm(robot, q, pose, cap);
  x = to_coordinates(robot.mobility, pose);
  return result;
}

Status motors_pose(Level level, const Robot& robot, const Joint& q, Pose& pose, Parasitic& rest) {
  return by_engine(level, robot) && engine_closes(robot) ? motors_pose_full(robot, q, pose, rest)
                                                         : fkm(robot, q, pose, kFkmStart).status;
}

Outcome jacobian(Level level, const Robot& robot, const Coordinates& x, JointMatrix& J) {
  const auto of = [&](const auto& at) { return jacobian(robot, at, J); };
  return closed(level, robot, to_pose(robot.mobility, x), of, nullptr, false);
}

Outcome placed(const Robot& robot, const Pose& pose, Pose& platform) {
  if (!is_mechanism(robot.mobility)) {
    platform = placed(robot, pose);
    return {};
  }
  const auto of = [&](const FullClosure& closure) {
    const engine::Frame& frame = closure.at.frame[closure.built.platform];
    platform = {frame.p, frame.R, 0};
    return Outcome{};
  };
  return levels_detail::closed_full(robot, pose, of, nullptr);
}

Outcome extended(Level level, const Robot& robot, const Pose& pose, Extended& q_e,
                 Parasitic* rest) {
  return closed(level, robot, pose, [&](const auto& at) { return read(robot, at, q_e); }, rest);
}

Outcome parasitic(const Robot& robot, const Coordinates& x, Coordinates& rest) {
  const Pose pose = to_pose(robot.mobility, x);
  rest.fill(0);
  return closed(Level::full, robot, pose, [&](const auto& at) {
    if constexpr (requires { at.pose.psi; }) {
      const Vec3 tilt = log_so3(at.pose.R * pose.R.transpose());
      const int tilts = turns_about_z(robot.mobility) ? 2 : 3;
      for (int k : range(tilts)) rest[k] = tilt[k];
      for (int k : range(tilts, dof(robot.mobility))) rest[k] = pose.theta + at.pose.psi[k - tilts];
    }
    return Outcome{};
  });
}
}  // namespace truepose
