// Kinematics at a level of the model: one rod per chain, or every rod by itself.
#pragma once

#include "mechanism/fkm.hpp"
#include "mechanism/full.hpp"

namespace truepose {
/// The level whose rods a robot's laws model.
inline Level level_of(const Robot& robot) {
  return robot.rod_by_rod() ? Level::full : Level::ideal;
}

/// Whether the engine closes the loops at a level, not the chains' closed forms.
inline bool by_engine(Level level, const Robot& robot) {
  return is_mechanism(robot.mobility) ||
         (level == Level::full && robot.full.kind != FullKind::same);
}

/// Whether the engine can: a described mechanism, or rods that hold the platform.
inline bool engine_closes(const Robot& robot) {
  return is_mechanism(robot.mobility) || robot.full.own();
}

namespace levels_detail {
/// Kept apart from the ideal level, whose stack is small.
template <class F>
[[gnu::noinline]] Outcome closed_full(const Robot& robot, const Pose& pose, F& f, Parasitic* rest) {
  FullClosure closure;
  const Outcome outcome = ikm(robot, pose, closure, rest);
  return outcome ? f(closure) : outcome;
}
}  // namespace levels_detail

/// f(closure) with all loops closed at a pose: a FullClosure where the rods have a model of their
/// own at this level, else a Closure.
/// @param rest   as of ikm to a FullClosure; at the ideal level a closing takes one step
/// @param angle  as of ikm to a Closure
/// @return also no_full_level (robot.full)
template <class F>
Outcome closed(Level level, const Robot& robot, const Pose& pose, F&& f, Parasitic* rest = nullptr,
               bool angle = true) {
  if (!robot.finished) return {Status::unfinished};
  if (by_engine(level, robot))
    return engine_closes(robot) ? levels_detail::closed_full(robot, pose, f, rest)
                                : Outcome{Status::no_full_level};
  if (rest) {
    if (rest->most(true) < 1) return {Status::not_converged};
    rest->take(1 - kClosing);  // half as much work
  }
  Closure closure;
  const Outcome outcome = ikm(robot, pose, closure, angle);
  return outcome ? f(closure) : outcome;
}

/// q = IKM(x).
/// @return joint_limit where a motor would have to pass its stops (`q` then says how far)
Outcome ikm(Level level, const Robot& robot, const Coordinates& x, Joint& q);

/// x = FKM(q). @param x  in: the guess; out: the pose. @param cap  maximum steps, at least 1
FkmResult fkm(Level level, const Robot& robot, const Joint& q, Coordinates& x, int cap = kFkmCap);

/// The motors' pose, where another search starts; of the ideal level where there is no other.
/// @param rest  in: residual motion at a pose nearby; out: at this one, if ok
Status motors_pose(Level level, const Robot& robot, const Joint& q, Pose& pose, Parasitic& rest);

/// J(x), n×m, ẋ = J q̇; ẋ is a twist (its free columns), base frame.
Outcome jacobian(Level level, const Robot& robot, const Coordinates& x, JointMatrix& J);

/// D and R of the platform.
Outcome placed(const Robot& robot, const Pose& pose, Pose& platform);

/// q_e at a pose, as the robot's own encoders read them.
/// @return not_measured: an angle at the hinge of a missing bar; not_finite: a sensor cannot read
Outcome extended(Level level, const Robot& robot, const Pose& pose, Extended& q_e,
                 Parasitic* rest = nullptr);

/// Residual motion at the full level: the platform's turns against the ideal R (about x and y, of a
/// translation robot about z as well) and each bar's turn against the base, θ + ψ_k.
Outcome parasitic(const Robot& robot, const Coordinates& x, Coordinates& rest);
}  // namespace truepose
