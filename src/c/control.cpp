// Laws, controllers and fault-tolerant controllers for C.
#include "c/controllers.hpp"

using namespace truepose;

namespace truepose::c {
namespace {
/// Whether an enum, which C may have made, is one of `count` from 0.
bool below(auto value, std::size_t count) { return static_cast<std::size_t>(value) < count; }
bool law_exists(Law law) { return below(law, kLawTable.size()); }
}  // namespace

Outcome columns_exist(const Robot& robot, const truepose_knowledge& known, int least) {
  const int all = parameter_count(robot);
  if (known.count < least || known.count > all) return {Status::no_such_part, -1};
  for (int k = 0; k < known.count; ++k)
    if (known.column[k] < 0 || known.column[k] >= all) return {Status::no_such_part, k};
  return {};
}

Status status_of(const ControlSettings& s) {
  if (!law_exists(s.law) || !below(s.gains, 2) || !below(s.feed_forward, 3))
    return Status::no_such_part;
  if (!finite(s)) return Status::not_finite;
  const bool good = s.period > 0 && s.velocity_bandwidth > 0 && s.damped_below >= 0 &&
                    s.lead_out >= 0 && s.sigma_scale >= 0;
  return good ? Status::ok : Status::no_such_value;
}

Status status_of(const FaultMonitorSettings& s) {
  if (!finite(s)) return Status::not_finite;
  bool good = s.refresh > 0 && s.coast > 0 && s.decide > 0 && s.decide < 1 << 20 && s.spikes > 0 &&
              s.spikes <= kSpikesKept && s.within > 0;
  good = good && s.false_alarm > 0 && s.false_alarm < 0.1;
  for (const Real number : {s.period, s.replaceable, s.correlation, s.stop, s.stop_lost, s.held})
    good = good && number > 0;
  for (int c = 0; c < kMaxReadings; ++c)
    good = good && s.low[c] <= s.high[c] && s.fastest[c] >= 0 && s.moved[c] >= 0;
  for (const Real growth : s.growth)
    good = good && growth >= 0 && growth < 1 && (growth == 0 || s.memory > 0);
  return good ? Status::ok : Status::no_such_value;
}

namespace {
void report_on(const FaultTolerantSetup& setup, truepose_fault_report* report) {
  const FaultMonitor& monitor = setup.state.monitor;
  *report = truepose_fault_report{};
  for (int c = 0; c < kMaxReadings; ++c) {
    report->health[c] = static_cast<std::int32_t>(monitor.reading[c].health);
    report->symptom[c] = static_cast<std::int32_t>(monitor.reading[c].symptom);
  }
  report->doubted = monitor.doubted;
  report->lost = monitor.lost;
  report->brakes = setup.state.brakes;
  report->stops = setup.state.stops || monitor.undecided || monitor.lost != 0;
  const FaultMonitorSettings& settings = setup.settings.monitor;
  if (report->stops) report->stop = monitor.lost ? settings.stop_lost : settings.stop;
}

/// The servo cycle of a law.
Outcome servo(const Robot& robot, Law law, Real band, const truepose_real* x_d, const Extended& q_e,
              const Weighing& weighing, Parasitic* nearby, truepose_servo_cycle* cycle) {
  ServoCycle found;
  const Outcome outcome = motor_error(robot, law, values<Coordinates>(x_d), q_e, found.error, band,
                                      weighing, nearby, &found);
  if (outcome) *cycle = converted<truepose_servo_cycle>(found);
  return outcome;
}
}  // namespace
}  // namespace truepose::c

extern "C" {
size_t truepose_work(const truepose_model* model, int32_t count) {
  const Robot* robot = c::robot_of(model);
  return robot ? static_cast<std::size_t>(estimate_work(*robot, std::max(count, int32_t{0}))) : 0;
}

truepose_outcome truepose_servo(const truepose_model* model, int32_t law, truepose_real band,
                                const truepose_real* x_d, const truepose_real* q_e,
                                const truepose_knowledge* known, truepose_real* work,
                                truepose_servo_cycle* cycle) {
  const Law by{law};
  if (!c::law_exists(by)) return c::answer(Status::no_such_part);
  return c::asked(model, [&](const Robot& robot) {
    const c::Known weighs(robot, known, work, nullptr, properties(by).weighs);
    if (!weighs.sound) return weighs.sound;
    return c::servo(robot, by, band, x_d, c::values<Extended>(q_e), weighs.weighing, nullptr,
                    cycle);
  });
}

truepose_outcome truepose_joint_state(const truepose_model* model,
                                      const truepose_axis_state* motors, int32_t cap,
                                      truepose_axis_state* joints) {
  return c::asked(model, [&](const Robot& robot) -> Outcome {
    if (cap < 1 || cap > kFkmCap) return {Status::no_such_value, -1};
    auto found = c::converted<AxisState>(*joints);
    const Outcome outcome = joint_state(robot, c::converted<AxisState>(*motors), cap, found);
    if (outcome) *joints = c::converted<truepose_axis_state>(found);
    return outcome;
  });
}

truepose_outcome truepose_motor_command(const truepose_model* model,
                                        const truepose_axis_state* motors,
                                        const truepose_axis_state* joints,
                                        const truepose_axis_command* joint_command,
                                        truepose_axis_command* given) {
  return c::asked(model, [&](const Robot& robot) {
    AxisCommand found;
    const Outcome outcome =
        motor_command(robot, c::converted<AxisState>(*motors), c::converted<AxisState>(*joints),
                      c::converted<AxisCommand>(*joint_command), found);
    if (outcome) *given = c::converted<truepose_axis_command>(found);
    return outcome;
  });
}

void truepose_control_defaults(truepose_control_settings* settings) {
  *settings = c::converted<truepose_control_settings>(ControlSettings{});
}

truepose_outcome truepose_place_poles(const truepose_model* model, const truepose_real* x,
                                      truepose_real frequency, truepose_real damping,
                                      truepose_control_settings* settings) {
  return c::asked(model, [&](const Robot& robot) -> Outcome {
    if (!(frequency > 0 && damping > 0)) return {Status::no_such_value, -1};
    auto placed = c::converted<ControlSettings>(*settings);
    const Outcome outcome =
        place_poles(robot, c::values<Coordinates>(x), frequency, damping, placed);
    if (outcome) *settings = c::converted<truepose_control_settings>(placed);
    return outcome;
  });
}

size_t truepose_controller_size(void) { return sizeof(c::Controller); }

truepose_outcome truepose_controller_init(truepose_controller* controller, size_t size,
                                          const truepose_control_settings* settings) {
  ControlSettings all;
  Status status = c::take(*settings, all);
  if (status == Status::ok) status = c::status_of(all);
  if (status != Status::ok) return c::answer(status);
  c::Controller* made = c::Controller::make(controller, size);
  if (made == nullptr) return c::answer(c::kTooSmall);
  made->settings = all;
  return c::answer(Outcome{});
}

truepose_outcome truepose_change_law(truepose_controller* controller, int32_t law) {
  c::Controller* made = c::Controller::of(controller);
  if (made == nullptr) return c::answer(c::kUnfinished);
  if (!c::law_exists(Law{law})) return c::answer(Status::no_such_part);
  made->settings.law = Law{law};
  return c::answer(Outcome{});
}

truepose_outcome truepose_controller_servo(const truepose_model* model,
                                           truepose_controller* controller,
                                           const truepose_real* x_d, const truepose_real* q_e,
                                           const truepose_knowledge* known, truepose_real* work,
                                           truepose_servo_cycle* cycle) {
  return c::asked(model, [&](const Robot& robot) {
    c::Controller* made = c::Controller::of(controller);
    if (made == nullptr) return c::kUnfinished;
    const ControlSettings& settings = made->settings;
    const c::Known weighs(robot, known, work, &made->kept, properties(settings.law).weighs);
    if (!weighs.sound) return weighs.sound;
    Parasitic nearby = made->state.nearby;
    const c::Present now(robot, *made, q_e, weighs.weighing);
    const Scaled scaled(now.weighing, settings.sigma_scale);
    const Outcome outcome = c::servo(robot, settings.law, settings.damped_below, x_d, now.q_e,
                                     scaled.weighing, &nearby, cycle);
    if (outcome) made->state.nearby = nearby;
    return outcome;
  });
}

truepose_outcome truepose_control(const truepose_model* model, truepose_controller* controller,
                                  const truepose_setpoint* setpoint, const truepose_real* q_e,
                                  const truepose_knowledge* known, truepose_real* work,
                                  truepose_real* torque) {
  return c::asked(model, [&](const Robot& robot) {
    c::Controller* made = c::Controller::of(controller);
    if (made == nullptr) return c::kUnfinished;
    const c::Known weighs(robot, known, work, &made->kept, properties(made->settings.law).weighs);
    if (!weighs.sound) return weighs.sound;
    const c::Present now(robot, *made, q_e, weighs.weighing);
    const Outcome outcome = control(robot, made->settings, c::converted<Setpoint>(*setpoint),
                                    now.q_e, made->state, now.weighing);
    c::give(made->state.torque, torque);
    return outcome;
  });
}

size_t truepose_multirate_size(void) { return sizeof(c::SlowSensors); }

truepose_outcome truepose_multirate_init(truepose_multirate* sensors, size_t size,
                                         const truepose_multirate_settings* settings) {
  if (settings->size != sizeof *settings) return c::answer(Status::other_version);
  c::SlowSensors* made = c::SlowSensors::make(sensors, size);
  if (made == nullptr) return c::answer(c::kTooSmall);
  const Outcome outcome = start(c::converted<MultirateSettings>(*settings), made->late);
  if (!outcome) made->mark = 0;
  return c::answer(outcome);
}

truepose_outcome truepose_controller_sensors(truepose_controller* controller,
                                             truepose_multirate* sensors) {
  c::Controller* made = c::Controller::of(controller);
  c::SlowSensors* slow = sensors ? c::SlowSensors::of(sensors) : nullptr;
  if (made == nullptr || (sensors && slow == nullptr)) return c::answer(c::kUnfinished);
  made->late = slow ? &slow->late : nullptr;
  made->compensate = [](const Robot& robot, Multirate& late, c::Present& now) {
    now.weighing = compensated(robot, now.weighing, late, now.known, now.q_e);
  };
  return c::answer(Outcome{});
}

truepose_outcome truepose_multirate_arrive(truepose_multirate* sensors, uint32_t arrived,
                                           const uint64_t* time, uint64_t now, uint32_t* stale) {
  c::SlowSensors* slow = c::SlowSensors::of(sensors);
  if (slow == nullptr) return c::answer(c::kUnfinished);
  Multirate& late = slow->late;
  late.arrived = arrived & late.which;
  for (int k = 0; k < kMaxSensors; ++k)
    if (late.arrived & late.settings.stamped & bit(k)) {
      if (time)
        stamp(late, k, time[k], now);
      else
        late.arrived &= ~bit(k);
    }
  if (stale) *stale = arrived & late.which & ~late.arrived;
  return c::answer(Outcome{});
}

size_t truepose_fault_monitor_size(void) { return sizeof(c::FaultTolerantSetup); }

truepose_outcome truepose_fault_monitor_init(truepose_fault_monitor* monitor, size_t size,
                                             const truepose_fault_monitor_settings* settings) {
  FaultMonitorSettings all;
  Status status = c::take(*settings, all);
  if (status == Status::ok) status = c::status_of(all);
  if (status != Status::ok) return c::answer(status);
  c::FaultTolerantSetup* made = c::FaultTolerantSetup::make(monitor, size);
  if (made == nullptr) return c::answer(c::kTooSmall);
  prepare(all);
  made->settings.monitor = all;
  return c::answer(Outcome{});
}

truepose_outcome truepose_control_fault_tolerant(
    const truepose_model* model, const truepose_model* finest, truepose_controller* controller,
    truepose_fault_monitor* monitor, const truepose_setpoint* setpoint, const truepose_real* q_e,
    const truepose_knowledge* known, truepose_real* work, truepose_real* torque,
    truepose_fault_report* report) {
  return c::asked(model, [&](const Robot& robot) {
    c::Controller* made = c::Controller::of(controller);
    c::FaultTolerantSetup* setup = c::FaultTolerantSetup::of(monitor);
    if (made == nullptr || setup == nullptr) return c::kUnfinished;
    const c::Known weighs(robot, known, work, &made->kept);
    if (!weighs.sound) return weighs.sound;
    if (!c::monitors(*setup, robot, finest)) return c::kUnfinished;
    const Outcome outcome = control_fault_tolerant(
        robot, made->settings, setup->settings, c::converted<Setpoint>(*setpoint),
        c::values<Extended>(q_e), made->state, weighs.weighing, setup->state, made->late);
    c::give(made->state.torque, torque);
    c::report_on(*setup, report);
    return outcome;
  });
}

truepose_outcome truepose_fault_monitor_step(const truepose_model* finest,
                                             truepose_fault_monitor* monitor,
                                             const truepose_real* desired, const truepose_real* q_e,
                                             const truepose_knowledge* known, truepose_real* work,
                                             truepose_real* believed,
                                             truepose_fault_report* report) {
  return c::asked(finest, [&](const Robot& robot) {
    c::FaultTolerantSetup* setup = c::FaultTolerantSetup::of(monitor);
    if (setup == nullptr) return c::kUnfinished;
    const c::Known weighs(robot, known, work);
    if (!weighs.sound) return weighs.sound;
    const auto read = c::values<Extended>(q_e);
    Extended stands = read;
    const Outcome outcome =
        monitor_faults(robot, setup->settings.monitor, weighs.weighing, c::values<Joint>(desired),
                       read, setup->state.monitor, stands);
    if (outcome) c::give(stands, believed);
    c::report_on(*setup, report);
    return outcome;
  });
}

truepose_outcome truepose_fault_monitor_acknowledge(truepose_fault_monitor* monitor,
                                                    int32_t reading) {
  return c::of_monitor(monitor, [&](c::FaultTolerantSetup& setup) -> Outcome {
    if (!c::below(reading, kMaxReadings)) return {Status::no_such_part, reading};
    acknowledge(setup.state, reading);
    return {};
  });
}

truepose_outcome truepose_fault_monitor_led(truepose_fault_monitor* monitor,
                                            const truepose_real* led) {
  return c::of_monitor(monitor, [&](c::FaultTolerantSetup& setup) -> Outcome {
    if (!all_finite(led, kMaxMotors)) return {Status::not_finite, -1};
    setup.state.monitor.led = c::values<Joint>(led);
    return {};
  });
}

int32_t truepose_fault_monitor_warm(const truepose_fault_monitor* monitor) {
  const c::FaultTolerantSetup* setup = c::FaultTolerantSetup::of(monitor);
  return setup != nullptr && setup->state.monitor.warm_up.warm;
}

void truepose_advance(truepose_path_clock* clock, truepose_real period, truepose_real stop) {
  auto core = c::converted<PathClock>(*clock);
  core.advance(period, stop);
  *clock = c::converted<truepose_path_clock>(core);
}

void truepose_pace(const truepose_path_clock* clock, truepose_setpoint* setpoint) {
  const Setpoint paced = c::converted<PathClock>(*clock).paced(c::converted<Setpoint>(*setpoint));
  *setpoint = c::converted<truepose_setpoint>(paced);
}
}
