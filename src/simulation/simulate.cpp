// Closed-loop simulation: nominal controller, true plant.
#include "simulation/simulate.hpp"

namespace truepose {
Loop::Loop(const Robot& nominal, const Robot& truth, const ControlSettings& settings,
           const Coordinates& start, std::uint64_t seed, const Extras& extras)
    : nominal_(nominal),
      settings_(settings),
      extras_(extras),
      plant_(truth, extras.effects, to_pose(truth.mobility, start), seed),
      resting_(plant_.rest()),
      bus_(extras.bus ? *extras.bus : MultirateSettings{}) {
  if (extras.late)
    if (const Outcome started = truepose::start(*extras.late, late_); resting_) resting_ = started;
  if (extras.guard) extras.guard->restart();
}

Outcome Loop::follow(int periods, int steps, const Path& path, const Write& write) {
  if (!resting_) return resting_;
  Cycle cycle;
  if (!report().follows) {
    const Outcome outcome = switch_on(path(0.0), cycle);
    if (!outcome || !report().follows) {
      write(sampled(0, path(0.0), cycle));
      return outcome;
    }
  }
  for (int k : range(periods + 1)) {
    const double time = k * settings_.period;
    const Setpoint setpoint =
        clock.rate < 1 ? clock.paced(path(clock.time / settings_.period)) : path(double(k));
    const bool late = extras_.effects.delayed && control_.started;  // torques
    const Joint before = report().torque;
    Outcome outcome = run_cycle(plant_, time, setpoint, cycle);
    if (!outcome) return outcome;
    write(sampled(time, setpoint, cycle));
    if (k == periods) break;
    if (clock.rate == 1 && !fault_state_.stops) clock.time = k * settings_.period;
    pace();
    const GuardReport machine = report();
    plant_.brake(machine.brakes, settings_.period);
    disturb(extras_.began + time);
    outcome = plant_.advance(late ? before : machine.torque, settings_.period, steps);
    if (!outcome) return outcome;
  }
  extras_.began += periods * settings_.period;
  return {};
}

Status Loop::step(const Setpoint& setpoint, const Extended& q_e, bool frozen) {
  Cycle cycle{q_e};
  static_cast<void>(run_controller(0, clock.paced(setpoint), cycle, frozen));
  pace();
  return cycle.status;
}

GuardReport Loop::report() const {
  if (extras_.guard) return extras_.guard->report();
  return {.state = -1,
          .cause = fault_state_.cause,
          .part = fault_state_.part,
          .brakes = fault_state_.brakes,
          .follows = true,
          .path_stop = fault_state_.stop,
          .torque = control_.torque};
}

void Loop::pace() {
  const GuardReport machine = report();
  if (!machine.follows) clock.rate = 0;
  clock.advance(settings_.period, machine.path_stop);
}

void Loop::disturb(double time) {
  const double from = time - settings_.period / 2, to = time + settings_.period / 2;
  for (const Event& event : extras_.events) {
    if (event.begin >= from && event.begin < to) plant_.disturb(event);
    if (event.kind == Disturbance::contact && event.end >= from && event.end < to)
      plant_.disturb(event, -1);
  }
}

Outcome Loop::run_cycle(Plant& plant, double time, const Setpoint& setpoint, Cycle& cycle) {
  const Outcome outcome = plant.measure(cycle.q_e);
  if (!outcome) return outcome;
  const double now = extras_.began + time;
  if (extras_.faults) extras_.faults->make_faulty(now, cycle.q_e);
  return run_controller(time, setpoint, cycle, extras_.faults && extras_.faults->frozen(now));
}

Outcome Loop::run_controller(double time, const Setpoint& setpoint, Cycle& cycle, bool frozen) {
  Extended& q_e = cycle.q_e;
  OnlineCalibrator* const calibrator = extras_.calibrator;
  Multirate* const late = extras_.late ? &late_ : nullptr;
  Monitored monitored;
  if (extras_.fault_settings && !extras_.law)
    monitored = {extras_.fault_settings, &fault_state_, late};
  late_.arrived = bus_.deliver(nominal_.motors, q_e);
  Extended present = q_e;
  Weighing weighing = monitored.state ? extras_.monitor_weighing : extras_.weighing;
  if (late && !monitored.state) weighing = compensated(nominal_, weighing, late_, known_, present);
  const bool calibrates = calibrator && time >= 0;
  cycle.gave_up =  // a row that fits no pose is skipped
      calibrates && !monitored.state &&
      calibrate_online(*calibrator, present).status == Status::stopped;
  const Robot& believed = calibrator ? calibrator->robot : nominal_;
  std::uint64_t& frame = extras_.guard ? extras_.guard->frame : fault_state_.frame.value;
  frame += !frozen;
  Outcome outcome;
  if (extras_.guard)
    outcome = run_guarded(believed, setpoint, present, weighing, monitored);
  else if (extras_.law)
    outcome = control_by_own_law(believed, setpoint, present);
  else if (monitored.state) {
    fault_state_.frame.given = true;
    outcome = control_fault_tolerant(believed, settings_, *monitored.settings, setpoint, present,
                                     control_, weighing, fault_state_, late);
  } else
    outcome = control(believed, settings_, setpoint, present, control_, weighing);
  if (calibrates && monitored.state) {
    for (int k : range(nominal_.r))
      if (late_.is(k)) present[nominal_.motors + k] = late_.present[k];
    cycle.gave_up = calibrate_monitored(*calibrator, present);
  }
  if (!extras_.law) control_.started = control_.started || outcome;
  cycle.status = outcome.status;
  return outcome || extras_.faults || extras_.guard ? Outcome{} : outcome;
}

Outcome Loop::control_by_own_law(const Robot& believed, const Setpoint& setpoint,
                                 const Extended& q_e) {
  Joint q{};
  const Outcome outcome = command(Level::ideal, believed, setpoint.x, q);
  if (!outcome) return outcome;
  const Joint error = extras_.law(setpoint.x, q_e);
  Extended shown{};
  for (int i : range(nominal_.motors)) shown[i] = q[i] - error[i];
  return control(believed, settings_, setpoint, shown, control_);
}

Outcome Loop::run_guarded(const Robot& believed, const Setpoint& setpoint, const Extended& q_e,
                          const Weighing& weighing, const Monitored& monitored) {
  Guard& guard = *extras_.guard;
  if (!extras_.law)
    return control_guarded(believed, settings_, setpoint, q_e, control_, guard, weighing,
                           monitored);
  const Pose pose = to_pose(nominal_.mobility, setpoint.x);
  ControlState own;  // its error is not known
  Outcome answer = command(Level::ideal, believed, pose, own.q_d);
  if (answer)
    answer = inverse_dynamics(believed, pose, setpoint.rate, setpoint.acceleration, own.load);
  if (answer && guard.report().follows) answer = control_by_own_law(believed, setpoint, q_e);
  own.torque = control_.torque;
  guard.guard(believed, setpoint, q_e, answer, own, nullptr);
  return answer;
}

Outcome Loop::switch_on(const Setpoint& setpoint, Cycle& cycle) {
  Plant waits(plant_);
  for (int k = 0; extras_.guard->begins(k); ++k) {
    const Outcome outcome = run_cycle(waits, -settings_.period, setpoint, cycle);
    if (!outcome) return outcome;
  }
  return {};
}

Sample Loop::sampled(double time, const Setpoint& setpoint, const Cycle& cycle) const {
  Sample sample{time,         setpoint.x,     to_coordinates(nominal_.mobility, plant_.pose()),
                cycle.q_e,    control_.error, cycle.status,
                cycle.gave_up};
  sample.stops = fault_state_.stops;
  sample.machine = report();
  if (extras_.fault_settings && extras_.fault_settings->supervisor)
    sample.disturbance = extras_.fault_settings->supervisor->disturbance();
  sample.refused = sample.disturbance.refused;
  for (int c : range(nominal_.motors + nominal_.r)) {
    sample.health[c] = fault_state_.monitor.reading[c].health;
    sample.symptom[c] = fault_state_.monitor.reading[c].symptom;
  }
  return sample;
}

bool Loop::calibrate_monitored(OnlineCalibrator& calibrator, const Extended& q_e) {
  const FaultMonitor& monitor = fault_state_.monitor;
  const bool valid = std::ranges::all_of(monitor.reading, [](const MonitoredReading& reading) {
    return reading.health == Health::valid;
  });
  if (valid) return calibrate_online(calibrator, q_e).status == Status::stopped;
  if (monitor.changed) control_.switched = bool(roll_back(calibrator)) || control_.switched;
  return calibrator.state.test.stopped;
}
}  // namespace truepose
