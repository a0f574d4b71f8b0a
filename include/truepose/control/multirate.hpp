// Multirate and delayed sensors: prediction of their present value.
//
// A reading is h(x) + p, h the believed sensor at the pose x that the motors alone give. What they
// say of where the nacelle is may be off by millimetres, but of how it moved in a few milliseconds
// by a hundredth of that way: p, what the geometry has wrong, is a function of the pose, and slow.
// So of a sample y taken at s
//
//     p = y - h(x(s)),        reading now = h(x(t)) + p
//
// until the next. What follows fast is the motors' own; a loop closed through p would be late, and
// is slow: laws act on p behind a low pass of the time that it is late anyway, and a slower one of
// what is less than counts, which the robot would hunt. What p has changed by on the way since is
// an error of the reading, of the known variance |sensitivity (x(t) - x(s))|².
#pragma once

#include "truepose/control/parity.hpp"

namespace truepose {

inline constexpr int kOldest = 255;       ///< age, control periods
inline constexpr int kSlowest = 1 << 20;  ///< from sample to sample, control periods
inline constexpr Real kCalmest = 0.1;     ///< pace of the low pass for what is less than counts
inline constexpr Real kCounts = 3;        ///< σ from which on p is followed rather than averaged

/// Which sensors are slow or late. Constant during a run: fill it, then call start().
struct MultirateSettings {
  std::array<int, kMaxSensors> every{};  ///< from sample to sample, control periods; 0 as 1
  std::array<int, kMaxSensors> age{};    ///< of a sample when it arrives, control periods
  /// By how much p changes along each freedom of the nacelle, σ: rad or m, per m or rad.
  Matrix<kMaxSensors, kMaxDof> sensitivity{};

  bool is(int sensor) const { return every[sensor] > 1 || age[sensor] > 0; }
};

/// What is remembered of them. Plain data, the caller's.
struct Multirate {
  // From start():
  MultirateSettings settings;
  std::uint32_t which = 0;  ///< sensors that are slow or late, as bits
  Reading pole{};           ///< of each one's low pass

  std::uint32_t arrived = 0;  ///< in: those of which this cycle has a new sample, as bits
  std::int64_t cycle = 0;     ///< that comes next
  bool placed = false;        ///< the motors had a pose in the last cycle
  Pose pose;                  ///< theirs
  Coordinates motion{};       ///< in that cycle,
  Coordinates way{};          ///< and since the start
  Reading expected{};         ///< h there,
  Reading change{};           ///< and by how much that has changed
  Reading noise{};            ///< variance of h, by the motors' noise and counts
  Matrix<kOldest + 1, kMaxSensors> was{};    ///< h of the last cycles: a ring,
  Matrix<kOldest + 1, kMaxDof> was_there{};  ///< as `way` is
  Reading sample{};                          ///< the last that arrived, as read,
  Reading then{};                            ///< h when it was taken,
  Matrix<kMaxSensors, kMaxDof> there{};      ///< `way` then,
  Matrix<kMaxSensors, kMaxDof> before{};     ///< of the sample before that,
  Reading off{};                             ///< and p
  Reading slow{};                            ///< p behind the low pass; where begun
  Matrix<kMaxSensors, kMaxDof> slowly{};     ///< `there`, likewise
  std::uint32_t begun = 0;
  Reading present{};  ///< what they would read now

  bool is(int sensor) const { return (which & bit(sensor)) != 0; }
};

/// Starts anew. @return no_such_part and the first sensor whose period or age is none, or too long
inline Outcome start(const MultirateSettings& settings, Multirate& late) {
  late = Multirate{};
  for (int k = 0; k < kMaxSensors; ++k) {
    const int every = std::max(1, settings.every[k]), age = settings.age[k];
    if (settings.every[k] < 0 || every > kSlowest || age < 0 || age > kOldest ||
        !all_finite(settings.sensitivity[k], kMaxDof)) {
      late.which = 0;
      return {Status::no_such_part, k};
    }
    if (settings.is(k)) late.which |= bit(k);
    late.pole[k] = std::exp(-1.0 / (every + age));
  }
  late.settings = settings;
  return {};
}

/// Sensors of which a sample arrives in a cycle, as bits, where the controller's clock, whole
/// cycles from 0, says when they are taken. In the first one what stood still before is read.
inline std::uint32_t arrivals(const MultirateSettings& settings, std::int64_t cycle) {
  std::uint32_t bits = 0;
  for (int k = 0; k < kMaxSensors; ++k) {
    const std::int64_t taken = cycle - settings.age[k];
    const bool due = taken >= 0 && taken % std::max(1, settings.every[k]) == 0;
    if (settings.is(k) && (due || cycle == 0)) bits |= bit(k);
  }
  return bits;
}

namespace late_detail {

/// The pose of the motors, and h there. @return no answer: none is closed by their readings
template <Mobility K>
inline Outcome place(const Robot& robot, const Extended& q_e, Multirate& late) {
  constexpr int n = kDof<K>;
  Extended fed{};  // the sensors as expected: the parity is by how much h has moved since
  std::copy_n(q_e.begin(), n, fed.begin());
  std::copy_n(late.expected.begin(), robot.r, fed.begin() + n);
  Pose near = moved<K>(late.pose, late.motion);
  Outcome outcome;
  if (!late.placed) {
    near = to_pose<K>(robot.home);
    outcome = {fkm<K>(robot, motors_of<K>(fed), near).status, -1};
  }
  Parity<K> parity;
  if (outcome) outcome = parity.place(robot, near, fed, Extended{});
  if (!outcome) return outcome;
  if (late.placed) late.motion = difference<K>(parity.pose, late.pose);
  late.pose = parity.pose;
  for (int k = 0; k < robot.r; ++k) {
    late.change[k] = -parity.value[k];
    late.noise[k] = 0;
    for (int j = 0; j < n; ++j) {
      const Chain& chain = robot.chain[j];
      late.noise[k] +=
          parity.g[k][j] * parity.g[k][j] *
          (chain.encoder_step * chain.encoder_step + chain.encoder_noise * chain.encoder_noise);
    }
  }
  return {};
}

}  // namespace late_detail

/// One cycle: late readings become present ones. Set `late.arrived` before; see arrivals().
/// Where the motors have no pose h goes on as it went.
/// @param robot  finished, with the sensors that `late` speaks of
/// @param q_e    in: as read; out: those that are slow or late as of now, NaN after such a sample
/// @return no answer: the first cycle has no pose, and counts for none
template <Mobility K>
Outcome compensate_latency(const Robot& robot, Multirate& late, Extended& q_e) {
  constexpr int n = kDof<K>;
  if (!robot.finished) return {Status::unfinished, -1};
  const bool first = late.cycle == 0;
  for (int k = 0; first && k < robot.r; ++k)  // in which turn it begins
    late.expected[k] = std::isfinite(q_e[n + k]) ? q_e[n + k] : 0;
  const Outcome placed = late_detail::place<K>(robot, q_e, late);
  if (!placed && first) return placed;
  late.placed = bool(placed);
  for (int i = 0; i < n && !first; ++i) late.way[i] += late.motion[i];
  for (int k = 0; k < robot.r; ++k) late.expected[k] += late.change[k];
  const auto at = [](std::int64_t cycle) { return static_cast<std::size_t>(cycle) & kOldest; };
  late.was[at(late.cycle)] = late.expected;
  late.was_there[at(late.cycle)] = late.way;
  if (first) late.arrived = late.which;
  for (int k = 0; k < robot.r; ++k) {
    if (!late.is(k)) continue;
    if (late.arrived & bit(k)) {  // before the first cycle the robot stood still
      const std::size_t taken = at(std::max<std::int64_t>(0, late.cycle - late.settings.age[k]));
      late.sample[k] = q_e[n + k];
      late.then[k] = late.was[taken][k];
      late.before[k] = first ? late.way : late.there[k];
      late.there[k] = late.was_there[taken];
      late.off[k] = within_turn(robot, n + k, late.sample[k] - late.then[k]);
    }
    late.present[k] = q_e[n + k] = late.expected[k] + late.off[k];
  }
  ++late.cycle;
  return {};
}

/// What laws act upon, once it is decided what is believed: p behind the low pass.
/// @param q_e    in and out: late readings as of now
/// @param holds  p stays: a motor that nothing reads must not be led by what comes late
inline void low_pass(const Robot& robot, Multirate& late, Extended& q_e, bool holds = false) {
  const int n = dof(robot.mobility);
  for (int k = 0; k < robot.r; ++k) {
    if (!late.is(k)) continue;
    const Real off = q_e[n + k] - late.expected[k];
    if (!std::isfinite(off)) continue;  // the law says so
    if (!(late.begun & bit(k))) {
      late.begun |= bit(k);
      late.slow[k] = off;
      late.slowly[k] = late.there[k];
    }
    const Sensor& sensor = robot.sensor[k];
    const Real news = (off - late.slow[k]) * (off - late.slow[k]);
    const Real counts = late.noise[k] + sensor.step * sensor.step + sensor.noise * sensor.noise;
    const Real follows = news > 0 ? news / (news + kCounts * kCounts * counts) : 0;
    const Real share = holds ? 0 : (1 - late.pole[k]) * std::max(kCalmest, follows);
    late.slow[k] += share * (off - late.slow[k]);
    for (int i = 0; i < n; ++i) late.slowly[k][i] += share * (late.there[k][i] - late.slowly[k][i]);
    q_e[n + k] = late.expected[k] + late.slow[k];
  }
}

namespace late_detail {

/// @param since  `way` where p is known
inline Real latency_variance(const Multirate& late, int sensor,
                             const std::array<Real, kMaxDof>& since) {
  Real variance = 0;
  for (int i = 0; i < kMaxDof; ++i) {
    const Real by = late.settings.sensitivity[sensor][i] * (late.way[i] - since[i]);
    variance += by * by;
  }
  return variance;
}

}  // namespace late_detail

/// The knowledge that laws act upon: p may have changed since where the low pass is, and counts
/// carried it. @param known  in and out
inline void weigh(const Robot& robot, const Multirate& late, Knowledge& known) {
  const int n = dof(robot.mobility);
  for (int k = 0; k < robot.r; ++k) {
    Real& sigma = known.sigma[n + k];
    if (late.is(k))
      sigma = std::sqrt(sigma * sigma + late.noise[k] +
                        late_detail::latency_variance(late, k, late.slowly[k]));
  }
}

}  // namespace truepose
