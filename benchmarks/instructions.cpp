// How many instructions does one call execute? The functions f_… that instructions.py counts.
// A count is the same on every run, whatever else the machine does; a time is not.
#include "bench.hpp"
#include "inputs.hpp"
#include "truepose/offline/plant.hpp"

using namespace inputs;

namespace {
constexpr Mobility kH4 = Mobility::schoenflies;
}

#define COUNTED extern "C" __attribute__((noinline))

COUNTED Status f_ikm(const Robot& robot, const Coordinates& x, Joint& q) {
  return ikm(robot, x, q).status;
}
COUNTED Status f_jacobian(const Robot& robot, const Coordinates& x, JointMatrix& J) {
  return jacobian(robot, x, J).status;
}
COUNTED Status f_fkm_near(const Robot& robot, const Joint& q, Coordinates& x) {
  return fkm(robot, q, x).status;
}
COUNTED Status f_fkm_home(const Robot& robot, const Joint& q, Coordinates& x) {
  return fkm(robot, q, x).status;
}
COUNTED Status f_fkm_closed(const Robot& robot, const Joint& q, const Mat3& R, Vec3& D) {
  return fkm_closed<kH4>(robot, q, R, Vec3(0, 0, -0.4), D).status;
}
COUNTED Status f_tej(const Robot& robot, const Coordinates& x, ExtendedColumns& M,
                     ExtendedRows& M_plus) {
  return tej(robot, x, M, M_plus).status;
}
COUNTED Status f_control_joint(const Robot& robot, const ControlSettings& settings,
                               const Setpoint& setpoint, const Extended& q_e, ControlState& state) {
  return control<kH4>(robot, settings, setpoint, q_e, state).status;
}
COUNTED Status f_control_redundant(const Robot& robot, const ControlSettings& settings,
                                   const Setpoint& setpoint, const Extended& q_e,
                                   ControlState& state) {
  return control<kH4>(robot, settings, setpoint, q_e, state).status;
}
COUNTED Status f_control_cartesian(const Robot& robot, const ControlSettings& settings,
                                   const Setpoint& setpoint, const Extended& q_e,
                                   ControlState& state) {
  return control<kH4>(robot, settings, setpoint, q_e, state).status;
}
COUNTED Status f_control_feed_forward(const Robot& robot, const ControlSettings& settings,
                                      const Setpoint& setpoint, const Extended& q_e,
                                      ControlState& state) {
  return control<kH4>(robot, settings, setpoint, q_e, state).status;
}
COUNTED Status f_control_inertia(const Robot& robot, const ControlSettings& settings,
                                 const Setpoint& setpoint, const Extended& q_e,
                                 ControlState& state) {
  return control<kH4>(robot, settings, setpoint, q_e, state).status;
}
COUNTED Status f_control_weighted(const Robot& robot, const ControlSettings& settings,
                                  const Setpoint& setpoint, const Extended& q_e,
                                  ControlState& state, const Weighing& weighing) {
  return control<kH4>(robot, settings, setpoint, q_e, state, weighing).status;
}
COUNTED Status f_control_estimated(const Robot& robot, const ControlSettings& settings,
                                   const Setpoint& setpoint, const Extended& q_e,
                                   ControlState& state, const Weighing& weighing) {
  return control<kH4>(robot, settings, setpoint, q_e, state, weighing).status;
}
COUNTED Status f_control_estimated_full(const Robot& robot, const ControlSettings& settings,
                                        const Setpoint& setpoint, const Extended& q_e,
                                        ControlState& state, const Weighing& weighing) {
  return control<kH4>(robot, settings, setpoint, q_e, state, weighing).status;
}
COUNTED Status f_forward_dynamics(const Robot& robot, const Pose& pose, const Coordinates& rate,
                                  Coordinates& acceleration) {
  return forward_dynamics<kH4>(robot, pose, rate, Joint{}, acceleration).status;
}
COUNTED Status f_ups_ikm(const Robot& robot, const Coordinates& x, Joint& q) {
  return ikm(robot, x, q).status;
}
COUNTED Status f_ups_jacobian(const Robot& robot, const Coordinates& x, JointMatrix& J) {
  return jacobian(robot, x, J).status;
}
COUNTED Status f_ups_fkm_near(const Robot& robot, const Joint& q, Coordinates& x) {
  return fkm(robot, q, x).status;
}

int main() {
  const Inputs<kH4> h4(mechanisms::h4());
  const Inputs<Mobility::spatial> ups(mechanisms::hexapod("6-UPS", Actuator::telescopic));
  const auto settings = [&](Law law) { return settings_for(h4.robot, law, FeedForward::none); };
  const ControlSettings joint = settings(Law::joint), redundant = settings(Law::redundant),
                        cartesian = settings(Law::cartesian), weighted = settings(Law::weighted),
                        estimated = settings(Law::estimated),
                        full = settings_for(h4.robot, Law::redundant, FeedForward::full);
  ControlSettings inertia = full;
  inertia.gains = Gains::inertia;
  if (!place_poles(h4.robot, h4.robot.home, 150, 1, inertia)) std::printf("home is singular\n");
  mechanisms::Prior prior(h4.robot);
  ControlState states[8];
  Robot rods = h4.robot;  // understood rod by rod, its axes 0.1° off
  rods.level = Level::full;
  for (int i = 0; i < 4; ++i) {
    Chain& chain = rods.chain[i];
    chain.axis =
        exp_so3(mechanisms::degrees(i % 2 == 0 ? 0.1 : -0.1) * chain.zero()) * chain.axis();
  }
  if (!finish(rods) || !finish_full(rods)) std::printf("the rods do not close at home\n");
  const auto answered = [](Status status) {
    if (status > Status::ok) std::printf("no answer: %s\n", describe(status));
  };
  for (int i = 0; i < kPoses; ++i) {
    Joint q{};
    Coordinates near = h4.near[i], home = h4.robot.home, ups_near = ups.near[i], acceleration{};
    JointMatrix J;
    ExtendedColumns M;
    ExtendedRows M_plus;
    Vec3 D = Vec3::Zero();
    answered(f_ikm(h4.robot, h4.x[i], q));
    answered(f_jacobian(h4.robot, h4.x[i], J));
    answered(f_fkm_near(h4.robot, h4.q[i], near));
    answered(f_fkm_home(h4.robot, h4.q[i], home));
    answered(f_fkm_closed(h4.robot, h4.q[i], h4.R[i], D));
    answered(f_tej(h4.robot, h4.x[i], M, M_plus));
    answered(f_control_joint(h4.robot, joint, h4.setpoint[i], h4.q_e[i], states[0]));
    answered(f_control_redundant(h4.robot, redundant, h4.setpoint[i], h4.q_e[i], states[1]));
    answered(f_control_cartesian(h4.robot, cartesian, h4.setpoint[i], h4.q_e[i], states[2]));
    answered(f_control_feed_forward(h4.robot, full, h4.setpoint[i], h4.q_e[i], states[3]));
    answered(f_control_inertia(h4.robot, inertia, h4.setpoint[i], h4.q_e[i], states[7]));
    answered(f_control_weighted(h4.robot, weighted, h4.setpoint[i], h4.q_e[i], states[4],
                                prior.weighing()));
    answered(f_control_estimated(h4.robot, estimated, h4.setpoint[i], h4.q_e[i], states[5],
                                 prior.weighing()));
    Extended q_e;  // a cycle after one nearby: what every cycle is but the first
    Parasitic rest;
    answered(exact_readings<kH4>(rods, to_pose<kH4>(h4.near[i]), q_e, rest).status);
    answered(control<kH4>(rods, estimated, {h4.near[i]}, q_e, states[6], prior.weighing()).status);
    answered(f_control_estimated_full(rods, estimated, h4.setpoint[i], q_e, states[6],
                                      prior.weighing()));
    answered(
        f_forward_dynamics(h4.robot, to_pose<kH4>(h4.x[i]), h4.setpoint[i].rate, acceleration));
    answered(f_ups_ikm(ups.robot, ups.x[i], q));
    answered(f_ups_jacobian(ups.robot, ups.x[i], J));
    answered(f_ups_fkm_near(ups.robot, ups.q[i], ups_near));
    bench::keep(D);  // or the call would be left out
  }
  std::printf("%d poses\n", kPoses);
  return 0;
}
