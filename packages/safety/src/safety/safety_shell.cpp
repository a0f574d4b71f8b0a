// The safety shell around a law: torques and brakes that follow from the checks of each cycle.
#include "safety/safety_shell.hpp"

namespace truepose {
namespace {
/// The steps of one cycle of a robot with n motors: machine, torques.
struct Step {
  int n;
  const SafetyLimits& limits;
  const SafetyCycle& cycle;
  SafetyShell& shell;
  Violations found = {};

  bool closed() const {  ///< the loop, or it is about to be
    return shell.machine.state == SafetyState::running || shell.machine.stop == StopKind::path;
  }
  /// Time for which the setpoint of a stop along the path stands still.
  void note_halt() {
    if (!cycle.answer) return;
    const bool halts = shell.machine.stop == StopKind::path &&
                       std::equal(cycle.q_d.begin(), cycle.q_d.begin() + n, shell.wanted.begin());
    shell.halted = halts ? shell.halted + limits.period : 0;
  }

  /// One transition. @return whether the state has changed
  bool transit() {
    const SafetyRequests& request = cycle.request;
    const SafetyMachine before = shell.machine;
    shell.refused = StopCause::none;
    const bool requested = request.start || request.stop || request.acknowledge;
    if (before.state == SafetyState::running && !found.causes && !requested) {  // as usual
      shell.started = shell.acknowledged = false;
      shell.since += limits.period;
      return false;
    }
    SafetyFindings now;
    now.start = request.start && !shell.started;
    now.acknowledge = request.acknowledge && !shell.acknowledged;
    now.stop = request.stop;
    shell.started = request.start;
    shell.acknowledged = request.acknowledge;
    constexpr std::uint32_t always = causes_with(&CauseProperties::always);
    constexpr std::uint32_t by_path = causes_with(&CauseProperties::by_path);
    const std::uint32_t violations = closed() ? found.causes : found.causes & always;
    now.violated = violations != 0;
    now.trusted = !(found.causes & ~by_path) && !cycle.suspected && cycle.answer && found.fresh &&
                  shell.follows;
    now.path_ended = shell.since >= limits.stop || shell.halted >= limits.brake;
    now.brakes_closed = shell.since >= limits.brake + limits.standstill;
    // Only a start or an acknowledgement needs more than the absence of a violation.
    if (now.start || now.acknowledge) {
      found.add(!shell.seen(n), StopCause::unknown_pose);
      now.healthy = found.causes == 0 && found.fresh;
    }
    shell.machine = next(before, now);
    const SafetyState state = shell.machine.state;
    const bool ready = state == SafetyState::ready, runs = state == SafetyState::running;
    if ((now.acknowledge && !ready && !runs) || (now.start && !runs))
      shell.refused = found.causes   ? found.first()
                      : !found.fresh ? StopCause::stale_frame
                      : request.stop ? StopCause::requested
                                     : StopCause::not_ready;
    if (violations) remember(violations);
    if (before.state == SafetyState::running && now.stop && !violations)
      remember(bit_of(StopCause::requested));
    if (ready && before.state != state) {
      shell.causes = 0;
      shell.cause = StopCause::none;
      shell.part = -1;
    }
    const bool same_stop = before.state == state && before.stop == shell.machine.stop;
    shell.since = same_stop ? shell.since + limits.period : 0;
    return !same_stop;
  }

  /// The first violation is the cause, before it a request.
  void remember(std::uint32_t causes) {
    if (!(shell.causes & ~bit_of(StopCause::requested))) {
      shell.cause = Violations{true, causes, {}}.first();
      shell.part = shell.cause == StopCause::requested
                       ? -1
                       : found.part[static_cast<std::size_t>(shell.cause)];
    }
    shell.causes |= causes;
  }
};
}  // namespace

void guard(const Robot& robot, const SafetyLimits& limits, const SafetyCycle& cycle,
           SafetyShell& shell) {
  const int n = robot.motors;
  const int freedoms = dof(robot.mobility);
  Step step{n, limits, cycle, shell};
  step.note_halt();
  step.found = check_limits(n, freedoms, limits, cycle, shell.follows, shell.torque, shell);
  step.found.add(!step.closed() && !consistent(limits, n, freedoms),
                 StopCause::contradictory_limits);
  step.found.add(!cycle.known || !cycle.placed, StopCause::unknown_pose);
  step.found.add(cycle.lost, StopCause::suspected_motor);
  step.found.add(cycle.disagree, StopCause::readings_disagree);
  const bool fresh = step.found.fresh;
  const bool began = step.transit();
  const SafetyMachine& machine = shell.machine;
  const bool runs = machine.state == SafetyState::running;
  const bool braking = machine.stop == StopKind::brake;

  shell.follows = shell.follows && step.closed();
  if (cycle.answer && fresh && (shell.follows || runs)) shell.at = cycle.x;
  if (began && (runs || braking)) {
    Joint weight{};
    if (inverse_dynamics(robot, to_pose(robot.mobility, shell.at), {}, {}, weight))
      shell.weight = weight;
    shell.opening = 0;
  }
  const auto set = [&](const Joint& target) { return approach(limits, n, target, shell.torque); };
  if (shell.follows) {
    set(cycle.answer && fresh ? cycle.torque : cycle.load);
  } else if (runs) {
    // The brakes open once the motors hold the weight, and the law acts once they have opened.
    if (set(shell.weight)) shell.opening += limits.period;
    shell.follows = shell.opening > limits.brake;
  } else {
    set(braking ? shell.weight : Joint{});
  }
  const bool open = shell.follows || (runs && shell.opening > 0);
  shell.brakes = open ? 0 : bit(n) - 1;
  shell.state = static_cast<int>(machine.state);
  shell.path_stop = machine.stop == StopKind::path ? limits.stop : 0;
}
}  // namespace truepose
