// Does any robot, setpoint, reading or change of law make a controller, the dynamics or the statics
// crash, hang or command a torque that is no number?
#include "control/control.hpp"
#include "decode.hpp"
#include "simulation/statics.hpp"

using namespace fuzz;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  Bytes bytes(data, size);
  const Subject subject = decode_robot(bytes);
  const Robot& robot = subject.robot;
  ControlSettings settings;
  settings.law = static_cast<Law>(bytes.below(5));
  settings.feed_forward = static_cast<FeedForward>(bytes.below(3));
  settings.gains = static_cast<Gains>(bytes.below(2));
  if (bytes.one_in(2)) settings.damped_below = std::fabs(bytes.share());
  if (place_poles(robot, decode_pose(bytes, subject), 150, 1, settings))
    require(all_finite(settings.kp, kMaxDof) && all_finite(settings.kd, kMaxDof),
            "place_poles: ok is finite");
  if (bytes.one_in(4)) {
    settings.period = bytes.number();
    settings.velocity_bandwidth = bytes.number();
    for (Joint* gain : {&settings.kp, &settings.kd, &settings.ki})
      for (double& value : *gain) value = bytes.number();
  }
  const Mobility K = robot.mobility;
  const int n = dof(K), m = robot.motors;
  mechanisms::Prior prior(robot);
  Weighing weighing = bytes.one_in(8) ? Weighing{} : prior.weighing();
  CachedGain kept;
  if (bytes.one_in(2)) weighing.kept = &kept;
  ControlState state;
  for (int cycle = 0; cycle < 4; ++cycle) {
    Setpoint setpoint;
    setpoint.x = decode_pose(bytes, subject);
    if (bytes.one_in(2))
      for (int i = 0; i < n; ++i) setpoint.rate[i] = bytes.number();
    if (bytes.one_in(2))
      for (int i = 0; i < n; ++i) setpoint.acceleration[i] = bytes.number();
    Extended q_e{};
    if (!extended(Level::ideal, robot, to_pose(K, decode_pose(bytes, subject)), q_e) ||
        bytes.one_in(4))
      for (int c = 0; c < readings(robot); ++c) q_e[c] = bytes.number();
    if (bytes.one_in(3)) settings.law = static_cast<Law>(bytes.below(5));
    const ControlState before = state;
    const Outcome outcome = control(robot, settings, setpoint, q_e, state, weighing);
    require(outcome || state.torque == before.torque, "a failed cycle holds the torque");
    // NaN gains and periods are settings, not readings: their torque is refused as well.
    require(all_finite(state.torque, m), "control: the torque is finite");
    require(all_finite(state.error, m), "control: the error is finite");
    require(all_finite(state.integral, m), "control: the integral is finite");
    require(
        all_finite(state.position, m) && all_finite(state.rate, m) && all_finite(state.desired, m),
        "control: the tracking loops are finite");
    Coordinates acceleration{};
    if (forward_dynamics(robot, to_pose(K, setpoint.x), setpoint.rate, state.torque, acceleration))
      require(all_finite(acceleration, n), "dynamics: ok is finite");
  }
  Robot truth = robot;
  for (int i = 0; i < m; ++i) truth.chain[i].rod *= 1 + 0.01 * bytes.share();
  Coordinates x{};
  if (settle(robot, truth, {settings, bytes.one_in(2)}, decode_pose(bytes, subject), x, weighing))
    require(all_finite(x, n), "settle: ok is finite");
  return 0;
}
