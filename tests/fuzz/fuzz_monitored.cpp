// Does a fault-tolerant controller stay within its limits, whatever its readings, its path, its
// laws and the people who restore readings do?
//
// Promised for any input: numbers, torques that the motors can, time that does not run backwards,
// a brake where nobody knows any more. How large a step is at most is a question to a healthy law
// and a stated fault, not to any: test_fault_monitor asks it.
#include <numbers>

#include "control/fault_tolerant_control.hpp"
#include "decode.hpp"

using namespace fuzz;

namespace {

void finite(const ControlState& state, int m, int rows) {
  require(all_finite(state.torque, m), "fault-tolerant: the torque is finite");
  require(all_finite(state.error, m) && all_finite(state.error_rate, m) &&
              all_finite(state.integral, m) && all_finite(state.load, m) &&
              all_finite(state.held, m) && all_finite(state.q_d, m),
          "fault-tolerant: what the controller keeps is finite");
  require(all_finite(state.position, rows) && all_finite(state.rate, rows) &&
              all_finite(state.desired, rows),
          "fault-tolerant: the tracking loops are finite");
}

void finite(const FaultMonitor& monitor, int rows, int r) {
  for (int c = 0; c < rows; ++c) {
    const MonitoredReading& reading = monitor.reading[c];
    require(std::isfinite(reading.track.value) && std::isfinite(reading.track.rate) &&
                std::isfinite(reading.scatter),
            "monitor: what it knows of a reading is finite");
    require(reading.health >= Health::valid && reading.health <= Health::failed &&
                reading.symptom >= Symptom::none && reading.symptom <= Symptom::disagrees,
            "monitor: health and symptom exist");
  }
  for (int k = 0; k < r; ++k)
    require(std::isfinite(monitor.parity[k].value) && std::isfinite(monitor.parity[k].rate),
            "monitor: the parity's trackers are finite");
}

/// One reading is spoilt, or two change places.
void spoil(Bytes& bytes, int rows, Extended& q_e) {
  const int c = bytes.below(rows);
  switch (bytes.below(5)) {
    case 0: q_e[c] = NAN; break;
    case 1: q_e[c] = bytes.number(); break;
    case 2: q_e[c] += 0.3 * bytes.share(); break;
    case 3: std::swap(q_e[c], q_e[bytes.below(rows)]); break;
    default: q_e[c] += 2 * std::numbers::pi; break;
  }
}

void drive_with_faults(Bytes& bytes, const Subject& subject) {
  const Robot& robot = subject.robot;
  const Mobility K = robot.mobility;
  const int n = dof(K), m = robot.motors;
  const int rows = m + robot.r;
  ControlSettings settings;
  settings.law = static_cast<Law>(bytes.below(5));
  settings.gains = static_cast<Gains>(bytes.below(2));
  static_cast<void>(place_poles(robot, robot.home, 100, 1, settings));
  if (!all_finite(settings.kp, m)) settings.kp = settings.kd = {};
  FaultTolerantSettings fault_settings;
  if (bytes.one_in(2)) fault_settings.monitor.fastest.fill(500);
  if (bytes.one_in(2)) fault_settings.monitor.moved.fill(2e-3);
  if (bytes.one_in(2)) {
    fault_settings.monitor.rests.fill(bytes.one_in(4) ? bytes.number() : 1e-3);
    fault_settings.monitor.kp = settings.kp;
    fault_settings.monitor.kd = settings.kd;
  }
  if (bytes.one_in(4)) fault_settings.monitor.shaken.fill(bytes.one_in(4) ? bytes.number() : 1e-4);
  if (bytes.one_in(4)) fault_settings.monitor.refresh = bytes.below(4);
  if (bytes.one_in(4)) fault_settings.monitor.spikes = bytes.byte() - 5;
  prepare(fault_settings.monitor);
  mechanisms::Prior prior(robot);
  ControlState state;
  FaultTolerantState fault_state;
  PathClock clock;
  // Mostly long enough for the trackers to settle, and to be led out and stopped.
  const int cycles = 40 + bytes.byte();
  const double speed = 10 * bytes.share();
  const Coordinates start = bytes.one_in(4) ? decode_pose(bytes, subject) : robot.home;
  int faulty = 0;  // cycles for which the last spoilt reading stays so
  Extended kept{};
  std::uint32_t wrong = 0;
  for (int k = 0; k < cycles; ++k) {
    Setpoint at;
    at.x = start;
    for (int i = 0; i < n; ++i) {
      at.x[i] += 0.1 * subject.box[i] * std::sin(speed * clock.time);
      at.rate[i] = 0.1 * subject.box[i] * speed * std::cos(speed * clock.time);
    }
    if (bytes.one_in(64)) at.x[bytes.below(n)] = bytes.number();
    if (bytes.one_in(64)) at.acceleration[bytes.below(n)] = bytes.number();
    Extended q_e{};
    if (!extended(Level::ideal, robot, to_pose(K, at.x), q_e)) q_e = kept;
    for (int c = 0; c < rows; ++c)
      if (faulty > 0 && wrong & bit(c)) q_e[c] = kept[c];
    faulty = std::max(0, faulty - 1);
    if (bytes.one_in(16)) {
      const Extended right = q_e;
      spoil(bytes, rows, q_e);
      wrong = 0;
      for (int c = 0; c < rows; ++c) wrong |= right[c] == q_e[c] ? 0 : bit(c);
      faulty = bytes.byte();
      kept = q_e;
    }
    if (bytes.one_in(32)) settings.law = static_cast<Law>(bytes.below(5));
    if (bytes.one_in(32)) acknowledge(fault_state, bytes.below(rows + 2) - 1);
    const double before = clock.time;
    clock.advance(settings.period, fault_state.stop);
    require(clock.time >= before && clock.rate >= 0 && clock.rate <= 1,
            "a path's time does not run backwards, nor faster");
    static_cast<void>(control_fault_tolerant(robot, settings, fault_settings, clock.paced(at), q_e,
                                             state, prior.weighing(), fault_state));
    finite(state, m, rows);
    finite(fault_state.monitor, rows, robot.r);
    for (int i = 0; i < m; ++i) {
      const double limit = robot.chain[i].torque_limit;
      require(!(limit > 0) || std::fabs(state.torque[i]) <= limit, "a torque that the motor can");
    }
    require(!(fault_state.unanswered > fault_settings.monitor.held) ||
                (fault_state.stops && fault_state.brakes),
            "without an answer the brakes hold");
    require(!fault_state.monitor.lost ||
                (fault_state.stops && (fault_state.brakes & fault_state.monitor.lost)),
            "a motor that nobody reads is held by its brake");
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  Bytes bytes(data, size);
  Subject subject = decode_robot(bytes);
  if (bytes.one_in(2))
    for (int i = 0; i < subject.robot.motors; ++i) subject.robot.chain[i].torque_limit = 50;
  drive_with_faults(bytes, subject);
  return 0;
}
