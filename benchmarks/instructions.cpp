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

COUNTED void f_ikm(const Robot& robot, const Joint& x, Joint& q) { ikm(robot, x, q); }
COUNTED void f_jacobian(const Robot& robot, const Joint& x, JointMatrix& J) {
  jacobian(robot, x, J);
}
COUNTED void f_fkm_near(const Robot& robot, const Joint& q, Joint& x) { fkm(robot, q, x); }
COUNTED void f_fkm_home(const Robot& robot, const Joint& q, Joint& x) { fkm(robot, q, x); }
COUNTED void f_fkm_closed(const Robot& robot, const Joint& q, const Mat3& R, Vec3& D) {
  fkm_closed<kH4>(robot, q, R, Vec3(0, 0, -0.4), D);
}
COUNTED void f_tej(const Robot& robot, const Joint& x, ExtendedColumns& M, ExtendedRows& M_plus) {
  tej(robot, x, M, M_plus);
}
COUNTED void f_control_joint(const Robot& robot, const ControlSettings& settings,
                             const Setpoint& setpoint, const Extended& q_e, ControlState& state) {
  control<kH4>(robot, settings, setpoint, q_e, state);
}
COUNTED void f_control_redundant(const Robot& robot, const ControlSettings& settings,
                                 const Setpoint& setpoint, const Extended& q_e,
                                 ControlState& state) {
  control<kH4>(robot, settings, setpoint, q_e, state);
}
COUNTED void f_control_cartesian(const Robot& robot, const ControlSettings& settings,
                                 const Setpoint& setpoint, const Extended& q_e,
                                 ControlState& state) {
  control<kH4>(robot, settings, setpoint, q_e, state);
}
COUNTED void f_control_feed_forward(const Robot& robot, const ControlSettings& settings,
                                    const Setpoint& setpoint, const Extended& q_e,
                                    ControlState& state) {
  control<kH4>(robot, settings, setpoint, q_e, state);
}
COUNTED void f_control_weighted(const Robot& robot, const ControlSettings& settings,
                                const Setpoint& setpoint, const Extended& q_e, ControlState& state,
                                const Weighing& weighing) {
  control<kH4>(robot, settings, setpoint, q_e, state, weighing);
}
COUNTED void f_control_estimated(const Robot& robot, const ControlSettings& settings,
                                 const Setpoint& setpoint, const Extended& q_e, ControlState& state,
                                 const Weighing& weighing) {
  control<kH4>(robot, settings, setpoint, q_e, state, weighing);
}
COUNTED void f_control_estimated_full(const Robot& robot, const ControlSettings& settings,
                                      const Setpoint& setpoint, const Extended& q_e,
                                      ControlState& state, const Weighing& weighing) {
  control<kH4>(robot, settings, setpoint, q_e, state, weighing);
}
COUNTED void f_forward_dynamics(const Robot& robot, const Pose& pose, const Joint& rate,
                                Joint& acceleration) {
  forward_dynamics<kH4>(robot, pose, rate, Joint{}, acceleration);
}
COUNTED void f_ups_ikm(const Robot& robot, const Joint& x, Joint& q) { ikm(robot, x, q); }
COUNTED void f_ups_jacobian(const Robot& robot, const Joint& x, JointMatrix& J) {
  jacobian(robot, x, J);
}
COUNTED void f_ups_fkm_near(const Robot& robot, const Joint& q, Joint& x) { fkm(robot, q, x); }

int main() {
  const Inputs<kH4> h4(mechanisms::h4());
  const Inputs<Mobility::spatial> ups(mechanisms::hexapod("6-UPS", Actuator::telescopic));
  const auto settings = [&](Law law) { return settings_for(h4.robot, law, FeedForward::none); };
  const ControlSettings joint = settings(Law::joint), redundant = settings(Law::redundant),
                        cartesian = settings(Law::cartesian), weighted = settings(Law::weighted),
                        estimated = settings(Law::estimated),
                        full = settings_for(h4.robot, Law::redundant, FeedForward::full);
  mechanisms::Prior prior(h4.robot);
  ControlState states[7];
  Robot rods = h4.robot;  // understood rod by rod, its axes 0.1° off
  rods.level = Level::full;
  for (int i = 0; i < 4; ++i) {
    Chain& chain = rods.chain[i];
    chain.axis =
        exp_so3(mechanisms::degrees(i % 2 == 0 ? 0.1 : -0.1) * chain.zero()) * chain.axis();
  }
  for (int i = 0; i < kPoses; ++i) {
    Joint out{}, near = h4.near[i], home = h4.robot.home, ups_near = ups.near[i];
    JointMatrix J;
    ExtendedColumns M;
    ExtendedRows M_plus;
    Vec3 D = Vec3::Zero();
    f_ikm(h4.robot, h4.x[i], out);
    f_jacobian(h4.robot, h4.x[i], J);
    f_fkm_near(h4.robot, h4.q[i], near);
    f_fkm_home(h4.robot, h4.q[i], home);
    f_fkm_closed(h4.robot, h4.q[i], h4.R[i], D);
    f_tej(h4.robot, h4.x[i], M, M_plus);
    f_control_joint(h4.robot, joint, h4.setpoint[i], h4.q_e[i], states[0]);
    f_control_redundant(h4.robot, redundant, h4.setpoint[i], h4.q_e[i], states[1]);
    f_control_cartesian(h4.robot, cartesian, h4.setpoint[i], h4.q_e[i], states[2]);
    f_control_feed_forward(h4.robot, full, h4.setpoint[i], h4.q_e[i], states[3]);
    f_control_weighted(h4.robot, weighted, h4.setpoint[i], h4.q_e[i], states[4], prior.weighing());
    f_control_estimated(h4.robot, estimated, h4.setpoint[i], h4.q_e[i], states[5],
                        prior.weighing());
    Extended q_e;  // a cycle after one nearby: what every cycle is but the first
    Parasitic rest;
    exact_readings<kH4>(rods, to_pose<kH4>(h4.near[i]), q_e, rest);
    control<kH4>(rods, estimated, {h4.near[i]}, q_e, states[6], prior.weighing());
    f_control_estimated_full(rods, estimated, h4.setpoint[i], q_e, states[6], prior.weighing());
    f_forward_dynamics(h4.robot, to_pose<kH4>(h4.x[i]), h4.setpoint[i].rate, out);
    f_ups_ikm(ups.robot, ups.x[i], out);
    f_ups_jacobian(ups.robot, ups.x[i], J);
    f_ups_fkm_near(ups.robot, ups.q[i], ups_near);
    bench::keep(D);  // or the call would be left out
  }
  std::printf("%d poses\n", kPoses);
  return 0;
}
