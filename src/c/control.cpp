// Laws, controllers and fault-tolerant controllers for C.
#include <bit>

#include "c/controllers.hpp"

using namespace truepose;

namespace truepose::c {
namespace {
bool law_exists(std::int32_t law) {
  return law >= 0 && law < static_cast<std::int32_t>(kLawTable.size());
}

Status status_of(const truepose_control_settings& s) {
  if (!law_exists(s.law) || s.gains < 0 || s.gains > 1 || s.feed_forward < 0 || s.feed_forward > 2)
    return Status::no_such_part;
  if (!finite(s, ControlSettings{})) return Status::not_finite;
  const bool good = s.period > 0 && s.velocity_bandwidth > 0 && s.damped_below >= 0 &&
                    s.lead_out >= 0 && s.sigma_scale >= 0;
  return good ? Status::ok : Status::no_such_value;
}

Status status_of(const truepose_fault_monitor_settings& s) {
  if (!finite(s, FaultTolerantSettings{})) return Status::not_finite;
  bool good = s.refresh > 0 && s.coast > 0 && s.decide > 0 && s.decide < 1 << 20 && s.spikes > 0 &&
              s.spikes <= kSpikesKept && s.within > 0;
  good = good && s.false_alarm > 0 && s.false_alarm < 0.1;
  for (const truepose_real number :
       {s.period, s.replaceable, s.correlation, s.stop, s.stop_lost, s.held})
    good = good && number > 0;
  for (int c = 0; c < kMaxReadings; ++c)
    good = good && s.low[c] <= s.high[c] && s.fastest[c] >= 0 && s.moved[c] >= 0;
  for (const truepose_real growth : s.growth) {
    if (growth > 0 && !kFollowsWarmUp) return Status::not_compiled;
    good = good && growth >= 0 && growth < 1 && (growth == 0 || s.memory > 0);
  }
  return good ? Status::ok : Status::no_such_value;
}

void report_on(const FaultTolerantSetup& setup, truepose_fault_report* report) {
  const FaultTolerantState& state = setup.state;
  *report = truepose_fault_report{};
  for (int c = 0; c < kMaxReadings; ++c) {
    report->health[c] = static_cast<std::int32_t>(state.monitor.reading[c].health);
    report->symptom[c] = static_cast<std::int32_t>(state.monitor.reading[c].symptom);
  }
  report->doubted = state.monitor.doubted;
  report->lost = state.monitor.lost;
  report->brakes = state.brakes;
  report->stops = state.stops || state.monitor.undecided || state.monitor.lost != 0;
  if (report->stops)
    report->stop = state.monitor.lost ? setup.settings.stop_lost : setup.settings.stop;
}

/// ê_q of a law; the other results of the cycle unless null.
truepose_outcome servo(const truepose_model* model, std::int32_t law, Real band,
                       const truepose_real* x_d, const truepose_real* q_e,
                       const truepose_knowledge* known, truepose_real* work, truepose_real* e,
                       ServoCycle* cycle) {
  if (!law_exists(law)) return answer({Status::no_such_part, -1});
  return asked(model, [&](const Robot& robot) {
    const Law by = static_cast<Law>(law);
    const Known weighs(robot, known, work, nullptr, properties(by).weighs);
    if (!weighs.sound) return weighs.sound;
    Joint error{};
    const Outcome outcome = motor_error(robot, by, values<Coordinates>(x_d), values<Extended>(q_e),
                                        error, band, weighs.weighing, nullptr, cycle);
    if (outcome) give(error, e);
    return outcome;
  });
}
}  // namespace
}  // namespace truepose::c

extern "C" {
size_t truepose_work(const truepose_model* model, int32_t count) {
  return c::of_robot(model, std::size_t{0}, [&](const Robot& robot) {
    return static_cast<std::size_t>(estimate_work(robot, std::max<std::int32_t>(count, 0)));
  });
}

truepose_outcome truepose_motor_error(const truepose_model* model, int32_t law, truepose_real band,
                                      const truepose_real* x_d, const truepose_real* q_e,
                                      const truepose_knowledge* known, truepose_real* work,
                                      truepose_real* e) {
  return c::servo(model, law, band, x_d, q_e, known, work, e, nullptr);
}

truepose_outcome truepose_servo(const truepose_model* model, int32_t law, truepose_real band,
                                const truepose_real* x_d, const truepose_real* q_e,
                                const truepose_knowledge* known, truepose_real* work,
                                truepose_servo_cycle* cycle) {
  ServoCycle found;
  const truepose_outcome outcome =
      c::servo(model, law, band, x_d, q_e, known, work, cycle->error, &found);
  if (outcome.status > TRUEPOSE_OK) return outcome;
  c::give(found.q_d, cycle->q_d);
  c::give(found.x, cycle->x);
  c::give(found.J, cycle->J);
  c::give(found.tej, cycle->tej);
  return outcome;
}

truepose_outcome truepose_joint_state(const truepose_model* model,
                                      const truepose_axis_state* motors, int32_t cap,
                                      truepose_axis_state* joints) {
  return c::asked(model, [&](const Robot& robot) -> Outcome {
    if (!is_rotational(Mobility::rotational_1)) return c::kNotRotational;
    if (cap < 1 || cap > kFkmCap) return {Status::no_such_value, -1};
    auto found = std::bit_cast<AxisState>(*joints);
    const Outcome outcome = joint_state(robot, std::bit_cast<AxisState>(*motors), cap, found);
    if (outcome) *joints = std::bit_cast<truepose_axis_state>(found);
    return outcome;
  });
}

truepose_outcome truepose_motor_command(const truepose_model* model,
                                        const truepose_axis_state* motors,
                                        const truepose_axis_state* joints,
                                        const truepose_axis_command* joint_command,
                                        truepose_axis_command* motor_command_) {
  return c::asked(model, [&](const Robot& robot) -> Outcome {
    if (!is_rotational(Mobility::rotational_1)) return c::kNotRotational;
    AxisCommand given;
    const Outcome outcome =
        motor_command(robot, std::bit_cast<AxisState>(*motors), std::bit_cast<AxisState>(*joints),
                      std::bit_cast<AxisCommand>(*joint_command), given);
    if (outcome) *motor_command_ = std::bit_cast<truepose_axis_command>(given);
    return outcome;
  });
}

void truepose_control_defaults(truepose_control_settings* settings) {
  c::describe(ControlSettings{}, *settings);
}

truepose_outcome truepose_place_poles(const truepose_model* model, const truepose_real* x,
                                      truepose_real frequency, truepose_real damping,
                                      truepose_control_settings* settings) {
  return c::asked(model, [&](const Robot& robot) -> Outcome {
    if (!(frequency > 0 && damping > 0)) return {Status::no_such_value, -1};
    ControlSettings placed = c::of_c(*settings);
    const Outcome outcome =
        place_poles(robot, c::values<Coordinates>(x), frequency, damping, placed);
    if (outcome) c::describe(placed, *settings);
    return outcome;
  });
}

size_t truepose_controller_size(void) { return sizeof(c::Controller); }

truepose_outcome truepose_controller_init(truepose_controller* controller, size_t size,
                                          const truepose_control_settings* settings) {
  truepose_control_settings all;
  Status status = c::take(*settings, ControlSettings{}, all);
  if (status == Status::ok) status = c::status_of(all);
  if (status != Status::ok) return c::answer({status, -1});
  c::Controller* made = c::Controller::make(controller, size);
  if (made == nullptr) return c::answer({Status::too_small, -1});
  made->settings = c::of_c(all);
  return c::answer({});
}

truepose_outcome truepose_change_law(truepose_controller* controller, int32_t law) {
  c::Controller* made = c::Controller::of(controller);
  if (made == nullptr) return c::answer(c::kUnfinished);
  if (!c::law_exists(law)) return c::answer({Status::no_such_part, -1});
  made->settings.law = static_cast<Law>(law);
  return c::answer({});
}

truepose_outcome truepose_controller_error(const truepose_model* model,
                                           truepose_controller* controller,
                                           const truepose_real* x_d, const truepose_real* q_e,
                                           const truepose_knowledge* known, truepose_real* work,
                                           truepose_real* e) {
  return c::asked(model, [&](const Robot& robot) {
    c::Controller* made = c::Controller::of(controller);
    if (made == nullptr) return c::kUnfinished;
    const ControlSettings& settings = made->settings;
    const c::Known weighs(robot, known, work, &made->kept, properties(settings.law).weighs);
    if (!weighs.sound) return weighs.sound;
    Joint error{};
    Parasitic nearby = made->state.nearby;
    const c::Present now(robot, *made, q_e, weighs.weighing);
    const Scaled scaled(now.weighing, settings.sigma_scale);
    const Outcome outcome = motor_error(robot, settings.law, c::values<Coordinates>(x_d), now.q_e,
                                        error, settings.damped_below, scaled.weighing, &nearby);
    if (!outcome) return outcome;
    made->state.nearby = nearby;
    c::give(error, e);
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
    const Outcome outcome = control(robot, made->settings, std::bit_cast<Setpoint>(*setpoint),
                                    now.q_e, made->state, now.weighing);
    c::give(made->state.torque, torque);
    return outcome;
  });
}

size_t truepose_multirate_size(void) { return sizeof(c::SlowSensors); }

truepose_outcome truepose_multirate_init(truepose_multirate* sensors, size_t size,
                                         const truepose_multirate_settings* settings) {
  if (settings->size != sizeof *settings) return c::answer({Status::other_version, -1});
  c::SlowSensors* made = c::SlowSensors::make(sensors, size);
  if (made == nullptr) return c::answer({Status::too_small, -1});
  MultirateSettings core;
  c::fields(*settings, core, c::Copy<true>{});
  const Outcome outcome = start(core, made->late);
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
  return c::answer({});
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
  return c::answer({});
}

size_t truepose_fault_monitor_size(void) { return sizeof(c::FaultTolerantSetup); }

truepose_outcome truepose_fault_monitor_init(truepose_fault_monitor* monitor, size_t size,
                                             const truepose_fault_monitor_settings* settings) {
  truepose_fault_monitor_settings all;
  Status status = c::take(*settings, FaultTolerantSettings{}, all);
  if (status == Status::ok) status = c::status_of(all);
  if (status != Status::ok) return c::answer({status, -1});
  c::FaultTolerantSetup* made = c::FaultTolerantSetup::make(monitor, size);
  if (made == nullptr) return c::answer({Status::too_small, -1});
  c::fields(all, made->settings, c::Copy<true>{});
  prepare(made->settings.monitor);
  return c::answer({});
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
        robot, made->settings, setup->settings, std::bit_cast<Setpoint>(*setpoint),
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
  c::FaultTolerantSetup* setup = c::FaultTolerantSetup::of(monitor);
  if (setup == nullptr) return c::answer(c::kUnfinished);
  if (reading < 0 || reading >= kMaxReadings) return c::answer({Status::no_such_part, reading});
  acknowledge(setup->state, reading);
  return c::answer({});
}

truepose_outcome truepose_fault_monitor_led(truepose_fault_monitor* monitor,
                                            const truepose_real* led) {
  c::FaultTolerantSetup* setup = c::FaultTolerantSetup::of(monitor);
  if (setup == nullptr) return c::answer(c::kUnfinished);
  const auto values = c::values<Joint>(led);
  if (!all_finite(values, kMaxMotors)) return c::answer({Status::not_finite, -1});
  setup->state.monitor.led = values;
  return c::answer({});
}

int32_t truepose_fault_monitor_warm(const truepose_fault_monitor* monitor) {
  const c::FaultTolerantSetup* setup = c::FaultTolerantSetup::of(monitor);
  return setup != nullptr && setup->state.monitor.warm_up.warm;
}

void truepose_advance(truepose_path_clock* clock, truepose_real period, truepose_real stop) {
  auto core = std::bit_cast<PathClock>(*clock);
  core.advance(period, stop);
  *clock = std::bit_cast<truepose_path_clock>(core);
}

void truepose_pace(const truepose_path_clock* clock, truepose_setpoint* setpoint) {
  const auto core = std::bit_cast<PathClock>(*clock);
  *setpoint = std::bit_cast<truepose_setpoint>(core.paced(std::bit_cast<Setpoint>(*setpoint)));
}
}
