// Multirate and delayed sensors: prediction of their present value.
#include "control/multirate.hpp"

namespace truepose {
void low_pass(const Robot& robot, Multirate& late, Extended& q_e, bool holds) {
  const int n = dof(robot.mobility), m = robot.motors;
  for (int k : range(robot.r)) {
    if (!late.is(k)) continue;
    const Real off = q_e[m + k] - late.expected[k];
    if (!isfinite(off)) continue;  // the law reports it
    if (!(late.begun & bit(k))) {
      late.begun |= bit(k);
      late.slow[k] = off;
      late.slowly[k] = late.there[k];
    }
    const Sensor& sensor = robot.sensor[k];
    const Real news = (off - late.slow[k]) * (off - late.slow[k]);
    const Real counts = late.noise[k] + sensor.step * sensor.step + sensor.noise * sensor.noise;
    const Real follows = news > 0 ? news / (news + kCounts * kCounts * counts) : 0;
    const Real share = holds ? 0 : (1 - late.pole[k]) * max(kCalmest, follows);
    late.slow[k] += share * (off - late.slow[k]);
    for (int i : range(n)) late.slowly[k][i] += share * (late.there[k][i] - late.slowly[k][i]);
    q_e[m + k] = late.expected[k] + late.slow[k];
  }
}

Outcome start(const MultirateSettings& settings, Multirate& late) {
  late = Multirate{};
  for (int k : range(kMaxSensors)) {
    const int every = max(1, settings.every[k]), age = settings.age[k];
    if (settings.every[k] < 0 || every > kSlowest || age < 0 || age > kOldest ||
        !all_finite(settings.sensitivity[k], kMaxDof) || !(settings.period > 0)) {
      late.which = 0;
      return {Status::no_such_part, k};
    }
    if (settings.is(k)) late.which |= bit(k);
    late.age[k] = age;
    late.pole[k] = exp(-1.0 / (every + age));
  }
  late.settings = settings;
  return {};
}

std::uint32_t arrivals(const MultirateSettings& settings, std::int64_t cycle) {
  std::uint32_t bits = 0;
  for (int k : range(kMaxSensors)) {
    const std::int64_t taken = cycle - settings.age[k];
    const bool due = taken >= 0 && taken % max(1, settings.every[k]) == 0;
    if (settings.is(k) && (due || cycle == 0)) bits |= bit(k);
  }
  return bits;
}

bool stamp(Multirate& late, int sensor, std::uint64_t time, std::uint64_t now) {
  late.arrived &= ~bit(sensor);
  const auto passed = [](std::uint64_t from, std::uint64_t to) {
    return Real(std::int64_t(to - from));
  };
  const Real age = passed(time, now) / (late.settings.period * 1e9);
  const bool newer = !(late.timed & bit(sensor)) || passed(late.taken[sensor], time) > 0;
  if (!newer || !(age >= 0 && age <= kOldest)) return false;
  late.arrived |= bit(sensor);
  late.timed |= bit(sensor);
  late.taken[sensor] = time;
  late.age[sensor] = age;
  // The loop through p is as late as the sample.
  late.pole[sensor] =
      exp(-1 / (max(1, late.settings.every[sensor]) + max<Real>(late.settings.age[sensor], age)));
  return true;
}
namespace {
/// Motors' pose, and h there. @return no answer: their readings close no pose
Outcome locate_motors(const Robot& robot, const Extended& q_e, Multirate& late) {
  const int n = robot.motors;
  Extended fed{};  // sensors as expected: the parity is minus the change of h
  copy_first(n, q_e, fed);
  copy_first(robot.r, late.expected, fed.begin() + n);
  Parity parity;
  const Outcome outcome = parity.locate(robot, late, fed, Extended{});
  if (!outcome) return outcome;
  if (late.placed) late.motion = difference(robot.mobility, parity.pose, late.pose);
  late.pose = parity.pose;
  for (int k : range(robot.r)) {
    late.change[k] = -parity.value[k];
    late.noise[k] = 0;
    for (int j : range(n)) {
      const Chain& chain = robot.chain[j];
      late.noise[k] +=
          parity.g[k][j] * parity.g[k][j] *
          (chain.encoder_step * chain.encoder_step + chain.encoder_noise * chain.encoder_noise);
    }
  }
  return outcome;
}
}  // namespace

Outcome compensate_latency(const Robot& robot, Multirate& late, Extended& q_e) {
  const int n = dof(robot.mobility), m = robot.motors;
  if (!robot.finished) return {Status::unfinished};
  const bool first = late.cycle == 0;
  for (int k = 0; first && k < robot.r; ++k)  // the initial turn
    late.expected[k] = isfinite(q_e[m + k]) ? q_e[m + k] : 0;
  const Outcome placed = locate_motors(robot, q_e, late);
  if (!placed && first) return placed;
  late.placed = bool(placed);
  for (int i : range(n)) late.way[i] += late.motion[i];
  for (int k : range(robot.r)) late.expected[k] += late.change[k];
  const auto at = [&](std::int64_t ago) -> ByMotors& {  // before the first cycle it stood still
    return late.was[std::size_t(max<std::int64_t>(0, late.cycle - ago)) & kOldest];
  };
  at(0) = late;
  if (first) late.arrived = late.which;
  for (int k : range(robot.r)) {
    if (!late.is(k)) continue;
    late.since[k] += 1;
    if (late.arrived & bit(k)) {
      const auto whole = std::int64_t(late.age[k]);
      const ByMotors &next = at(whole), &last = at(whole + 1);
      const auto then = [share = late.age[k] - Real(whole)](Real at_next, Real at_last) {
        return at_next + share * (at_last - at_next);
      };
      late.since[k] = first ? 0 : late.age[k];
      late.sample[k] = q_e[m + k];
      late.then[k] = then(next.expected[k], last.expected[k]);
      late.before[k] = first ? late.way : late.there[k];
      for (int i : range(n)) late.there[k][i] = then(next.way[i], last.way[i]);
      late.off[k] = within_turn(robot, m + k, late.sample[k] - late.then[k]);
    }
    const int longest = late.settings.age[k] + kDropped * max(1, late.settings.every[k]);
    if (!(late.since[k] <= longest)) late.off[k] = NAN;  // until the next sample
    late.present[k] = q_e[m + k] = late.expected[k] + late.off[k];
  }
  late.arrived = 0;
  ++late.cycle;
  return {};
}
Real latency_variance(const Multirate& late, int sensor, const std::array<Real, kMaxDof>& since) {
  Real variance = 0;
  for (int i : range(kMaxDof)) {
    const Real by = late.settings.sensitivity[sensor][i] * (late.way[i] - since[i]);
    variance += by * by;
  }
  return variance;
}
void weigh(const Robot& robot, const Multirate& late, Knowledge& known) {
  for (int k : range(robot.r)) {
    Real& sigma = known.sigma[robot.motors + k];
    if (late.is(k))
      sigma = sqrt(sigma * sigma + late.noise[k] + latency_variance(late, k, late.slowly[k]));
  }
}

Weighing compensated(const Robot& robot, const Weighing& weighing, Multirate& late,
                     Knowledge& known, Extended& q_e) {
  if (!compensate_latency(robot, late, q_e)) return weighing;
  low_pass(robot, late, q_e);
  if (!weighing) return weighing;
  known = *weighing.known;
  weigh(robot, late, known);
  return {&known, weighing.work, weighing.kept};
}
}  // namespace truepose
