// Laws, controllers and fault-tolerant controllers for C.
#include "c/controllers.hpp"

using namespace truepose;

namespace truepose::c {
namespace {
/// Whether an enum, which C may have made, is one of `count` from 0.
bool below(auto value, std::size_t count) { return std::size_t(value) < count; }
bool law_exists(Law law) { return below(law, kLawTable.size()); }
}  // namespace

Outcome columns_exist(const Robot& robot, const truepose_knowledge& known, int least) {
  const int all = parameter_count(robot);
  if (known.count < least || known.count > all) return Status::no_such_part;
  for (int k : range(known.count))
    if (known.column[k] < 0 || known.column[k] >= all) return {Status::no_such_part, k};
  return {};
}

Outcome sound(const ControlSettings& s) {
  if (!law_exists(s.law) || !below(s.gains, 2) || !below(s.feed_forward, 3))
    return Status::no_such_part;
  if (!finite(s)) return Status::not_finite;
  const bool good = s.period > 0 && s.velocity_bandwidth > 0 && s.damped_below >= 0 &&
                    s.lead_out >= 0 && s.sigma_scale >= 0;
  return {good ? Status::ok : Status::no_such_value};
}

Outcome sound(const FaultMonitorSettings& s) {
  if (!finite(s)) return Status::not_finite;
  bool good = s.refresh > 0 && s.coast > 0 && s.decide > 0 && s.decide < 1 << 20 && s.spikes > 0 &&
              s.spikes <= kSpikesKept && s.within > 0;
  good = good && s.false_alarm > 0 && s.false_alarm < 0.1;
  for (const Real number : {s.period, s.replaceable, s.correlation, s.stop, s.stop_lost, s.held})
    good = good && number > 0;
  for (int c : range(kMaxReadings))
    good = good && s.low[c] <= s.high[c] && s.fastest[c] >= 0 && s.moved[c] >= 0;
  return {good ? Status::ok : Status::no_such_value};
}

Outcome sound(const SafetyLimits& limits) {
  if (!finite(limits)) return Status::not_finite;
  return {limits.period > 0 ? Status::ok : Status::no_such_value};
}

namespace {
void report_on(const FaultTolerantSetup& setup, truepose_fault_report* report) {
  const FaultMonitor& monitor = setup.state.monitor;
  *report = truepose_fault_report{};
  for (int c : range(kMaxReadings)) {
    report->health[c] = std::int32_t(monitor.reading[c].health);
    report->symptom[c] = std::int32_t(monitor.reading[c].symptom);
  }
  report->doubted = monitor.doubted;
  report->lost = monitor.lost;
  report->brakes = setup.state.brakes;
  report->stop_cause = std::int32_t(setup.state.cause);
  report->stops = setup.state.stops || monitor.undecided || monitor.lost != 0;
  const FaultMonitorSettings& settings = setup.settings.monitor;
  if (report->stops) report->stop = monitor.lost ? settings.stop_lost : settings.stop;
}

/// The servo cycle of a law.
Outcome servo(const Robot& robot, Law law, Real band, const truepose_real* x_d, const Extended& q_e,
              const Weighing& weighing, Nearby* nearby, truepose_servo_cycle* cycle) {
  ServoCycle found;
  const Outcome outcome =
      servo_cycle(robot, law, in<Coordinates>(x_d), q_e, found, band, weighing, nearby);
  if (outcome) out(found, cycle);
  return outcome;
}
}  // namespace
}  // namespace truepose::c

using namespace truepose::c;

extern "C" {
size_t truepose_work(const truepose_model* model, int32_t count) {
  const Robot* robot = held(model);
  return robot ? std::size_t(estimate_work(*robot, max(count, int32_t{0}))) : 0;
}

truepose_outcome truepose_servo(const truepose_model* model, int32_t law, truepose_real band,
                                const truepose_real* x_d, const truepose_real* q_e,
                                const truepose_knowledge* known, truepose_real* work,
                                truepose_servo_cycle* cycle) {
  const Law by{law};
  if (!law_exists(by)) return answer(Status::no_such_part);
  return with(model, q_e)([&](const Robot& robot, const Extended& read) {
    const Known weighs(robot, known, work, nullptr, properties(by).weighs);
    if (!weighs.sound) return weighs.sound;
    return servo(robot, by, band, x_d, read, weighs.weighing, nullptr, cycle);
  });
}

truepose_outcome truepose_joint_state(const truepose_model* model,
                                      const truepose_axis_state* motors, int32_t cap,
                                      truepose_axis_state* joints) {
  if (cap < 1 || cap > kFkmCap) return answer(Status::no_such_value);
  return with(model, motors, cap, Both{joints})(joint_state);
}

truepose_outcome truepose_motor_command(const truepose_model* model,
                                        const truepose_axis_state* motors,
                                        const truepose_axis_state* joints,
                                        const truepose_axis_command* wanted,
                                        truepose_axis_command* given) {
  return with(model, motors, joints, wanted, given)(motor_command);
}

void truepose_control_defaults(truepose_control_settings* settings) {
  out(ControlSettings{}, settings);
}

truepose_outcome truepose_place_poles(const truepose_model* model, const truepose_real* x,
                                      truepose_real frequency, truepose_real damping,
                                      truepose_control_settings* settings) {
  if (!(frequency > 0 && damping > 0)) return answer(Status::no_such_value);
  return with(model, x, frequency, damping, Both{settings})(place_poles);
}

size_t truepose_controller_size(void) { return sizeof(Controller); }

truepose_outcome truepose_controller_init(truepose_controller* controller, size_t size,
                                          const truepose_control_settings* settings) {
  ControlSettings all;
  const Outcome sound = take_sound(*settings, all);
  return answer(begun(sound, controller, size, [&](Controller& made) { made.settings = all; }));
}

truepose_outcome truepose_change_law(truepose_controller* controller, int32_t law) {
  return with(controller)([&](Controller& made) -> Outcome {
    if (!law_exists(Law{law})) return Status::no_such_part;
    made.settings.law = Law{law};
    return {};
  });
}

truepose_outcome truepose_controller_servo(const truepose_model* model,
                                           truepose_controller* controller,
                                           const truepose_real* x_d, const truepose_real* q_e,
                                           const truepose_knowledge* known, truepose_real* work,
                                           truepose_servo_cycle* cycle) {
  return with(model, controller)([&](const Robot& robot, Controller& made) {
    const ControlSettings& settings = made.settings;
    const Present now(robot, made, q_e, known, work);
    if (!now.sound) return now.sound;
    Nearby nearby = made.state.nearby;
    const Scaled scaled(now.weighing, settings.sigma_scale);
    const Outcome outcome = servo(robot, settings.law, settings.damped_below, x_d, now.q_e,
                                  scaled.weighing, &nearby, cycle);
    if (outcome) made.state.nearby = nearby;
    made.state.nearby.search = nearby.search;
    return outcome;
  });
}

truepose_outcome truepose_control(const truepose_model* model, truepose_controller* controller,
                                  const truepose_setpoint* setpoint, const truepose_real* q_e,
                                  const truepose_knowledge* known, truepose_real* work,
                                  truepose_real* torque) {
  return with(model, controller)([&](const Robot& robot, Controller& made) {
    const Present now(robot, made, q_e, known, work);
    if (!now.sound) return now.sound;
    const Outcome outcome =
        control(robot, made.settings, in<Setpoint>(setpoint), now.q_e, made.state, now.weighing);
    out(made.state.torque, torque);
    return outcome;
  });
}

size_t truepose_multirate_size(void) { return sizeof(SlowSensors); }

truepose_outcome truepose_multirate_init(truepose_multirate* sensors, size_t size,
                                         const truepose_multirate_settings* settings) {
  const bool same = settings->size == sizeof *settings;
  const Outcome sound{same ? Status::ok : Status::other_version};
  return answer(begun(sound, sensors, size, [&](SlowSensors& made) {
    return start(in<MultirateSettings>(settings), made.late);
  }));
}

truepose_outcome truepose_controller_sensors(truepose_controller* controller,
                                             truepose_multirate* sensors) {
  return with(controller)([&](Controller& made) {
    SlowSensors* slow = sensors ? held(sensors) : nullptr;
    if (sensors && slow == nullptr) return kUnfinished;
    made.late = slow ? &slow->late : nullptr;
    made.compensate = [](const Robot& robot, Multirate& late, Present& now) {
      now.weighing = compensated(robot, now.weighing, late, now.present, now.q_e);
    };
    return Outcome{};
  });
}

truepose_outcome truepose_multirate_arrive(truepose_multirate* sensors, uint32_t arrived,
                                           const uint64_t* time, uint64_t now, uint32_t* stale) {
  return with(sensors)([&](SlowSensors& slow) {
    Multirate& late = slow.late;
    late.arrived = arrived & late.which;
    for (int k : range(kMaxSensors))
      if (late.arrived & late.settings.stamped & bit(k)) {
        if (time)
          stamp(late, k, time[k], now);
        else
          late.arrived &= ~bit(k);
      }
    if (stale) *stale = arrived & late.which & ~late.arrived;
  });
}

size_t truepose_fault_monitor_size(void) { return sizeof(FaultTolerantSetup); }

truepose_outcome truepose_fault_monitor_init(truepose_fault_monitor* monitor, size_t size,
                                             const truepose_fault_monitor_settings* settings) {
  FaultMonitorSettings all;
  const Outcome sound = take_sound(*settings, all);
  return answer(begun(sound, monitor, size, [&](FaultTolerantSetup& made) {
    prepare(all);
    made.settings.monitor = all;
  }));
}

truepose_outcome truepose_control_fault_tolerant(
    const truepose_model* model, const truepose_model* finest, truepose_controller* controller,
    truepose_fault_monitor* monitor, const truepose_setpoint* setpoint, const truepose_real* q_e,
    const truepose_knowledge* known, truepose_real* work, truepose_real* torque,
    truepose_fault_report* report) {
  return with(model, controller,
              monitor)([&](const Robot& robot, Controller& made, FaultTolerantSetup& setup) {
    const Known weighs(robot, known, work, &made.kept);
    if (!weighs.sound) return weighs.sound;
    if (!monitors(setup, robot, finest)) return kUnfinished;
    const Outcome outcome = control_fault_tolerant(
        robot, made.settings, setup.settings, in<Setpoint>(setpoint), in<Extended>(q_e), made.state,
        weighs.weighing, setup.state, made.late);
    out(made.state.torque, torque);
    report_on(setup, report);
    return outcome;
  });
}

truepose_outcome truepose_fault_monitor_step(const truepose_model* finest,
                                             truepose_fault_monitor* monitor,
                                             const truepose_real* desired, const truepose_real* q_e,
                                             const truepose_knowledge* known, truepose_real* work,
                                             truepose_real* believed,
                                             truepose_fault_report* report) {
  return with(finest, monitor)([&](const Robot& robot, FaultTolerantSetup& setup) {
    const Known weighs(robot, known, work);
    if (!weighs.sound) return weighs.sound;
    const auto read = in<Extended>(q_e);
    Extended stands = read;
    const Outcome outcome = monitor_faults(robot, setup.settings.monitor, weighs.weighing,
                                           in<Joint>(desired), read, setup.state.monitor, stands);
    if (outcome) out(stands, believed);
    report_on(setup, report);
    return outcome;
  });
}

truepose_outcome truepose_fault_monitor_acknowledge(truepose_fault_monitor* monitor,
                                                    int32_t reading) {
  return with(monitor)([&](FaultTolerantSetup& setup) -> Outcome {
    if (!below(reading, kMaxReadings)) return {Status::no_such_part, reading};
    acknowledge(setup.state, reading);
    return {};
  });
}

truepose_outcome truepose_fault_monitor_limit(truepose_fault_monitor* monitor,
                                              const truepose_safety_limits* limits) {
  return with(monitor)([&](FaultTolerantSetup& setup) -> Outcome {
    SafetyLimits all;
    const Outcome outcome = take_sound(*limits, all);
    if (outcome) setup.settings.limits = all, setup.settings.limited = true;
    return outcome;
  });
}

truepose_outcome truepose_fault_monitor_frame(truepose_fault_monitor* monitor, uint64_t counter) {
  return with(monitor)([&](FaultTolerantSetup& setup) -> Outcome {
    setup.state.frame = {true, counter};
    return {};
  });
}

truepose_outcome truepose_fault_monitor_led(truepose_fault_monitor* monitor,
                                            const truepose_real* led) {
  return with(monitor)([&](FaultTolerantSetup& setup) -> Outcome {
    if (!all_finite(led, kMaxMotors)) return Status::not_finite;
    setup.state.monitor.led = in<Joint>(led);
    return {};
  });
}

void truepose_advance(truepose_path_clock* clock, truepose_real period, truepose_real stop) {
  auto core = in<PathClock>(clock);
  core.advance(period, stop);
  out(core, clock);
}

void truepose_pace(const truepose_path_clock* clock, truepose_setpoint* setpoint) {
  out(in<PathClock>(clock).paced(in<Setpoint>(setpoint)), setpoint);
}
}
