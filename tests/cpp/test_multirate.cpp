// Slow and delayed sensors. The motors' motion carries the last sample to now.
#include "control/multirate.hpp"
#include "mechanisms.hpp"
#include "simulation/bus.hpp"

using namespace mechanisms;

namespace {

constexpr double kPeriod = 1e-3;

/// Cycle k of a smooth path about home, or a time between two.
Coordinates at(const Mechanism& mechanism, double k) {
  Coordinates x = mechanism.robot.home;
  for (int i = 0; i < dof(mechanism.robot.mobility); ++i)
    x[i] += 0.3 * mechanism.box[i] * std::sin(6 * kPeriod * k + i);
  return x;
}

Extended read_at(const Mechanism& mechanism, const Robot& truth, double k) {
  Extended q_e{};
  CHECK(extended(Level::ideal, truth, to_pose(truth.mobility, at(mechanism, k)), q_e));
  return q_e;
}

/// All sensors sampled every so many cycles, each sample so old.
MultirateSettings all_late(int every, int age) {
  MultirateSettings settings;
  settings.every.fill(every);
  settings.age.fill(age);
  return settings;
}
MultirateSettings all_stamped(int every, int age) {
  MultirateSettings settings = all_late(every, age);
  settings.stamped = bit(kMaxSensors) - 1;
  return settings;
}
std::uint64_t nanoseconds(double cycles) {
  return static_cast<std::uint64_t>(std::llround(cycles * kPeriod * 1e9));
}

}  // namespace

TEST_EACH(for_each, "samples with timestamps are carried from their own time, between cycles too") {
  if (robot.r == 0) return;
  for (const bool stamped : {true, false}) {
    Multirate late;
    CHECK(start(stamped ? all_stamped(10, 8) : all_late(10, 8), late));
    check::Random random(30);
    double farthest = 0, taken = 0.3, arrives = 9;
    Extended picture = read_at(mechanism, robot, taken), held = picture;
    const std::uint64_t base = ~std::uint64_t{0} - nanoseconds(200);  // the clock wraps
    for (int k = 0; k < 600; ++k) {
      const Extended now = read_at(mechanism, robot, k);
      late.arrived = 0;
      if (k >= arrives) {
        held = picture;
        for (int s = 0; s < robot.r && !stamped; ++s) late.arrived |= bit(s);
        for (int s = 0; s < robot.r && stamped; ++s)
          CHECK(stamp(late, s, base + nanoseconds(taken), base + nanoseconds(k)));
        taken = k + 0.37;
        arrives = k + 8 + 6 * random();
        picture = read_at(mechanism, robot, taken);
      }
      Extended q_e = k == 0 ? now : held;
      std::copy_n(now.begin(), motors, q_e.begin());
      CHECK(compensate_latency(robot, late, q_e));
      for (int c = motors; c < readings(robot) && k > 20; ++c)
        farthest = std::max(farthest, std::fabs(q_e[c] - now[c]));
    }
    // At most an eighth of the acceleration in one cycle squared.
    CHECK(stamped ? farthest < 3e-6 : farthest > 1e-4);
  }
}

TEST("a sample that is no newer than the last, from the future or too old counts as not arrived") {
  const Mechanism mechanism = h4();
  const Robot& robot = mechanism.robot;
  Multirate late;
  CHECK(start(all_stamped(10, 8), late));
  const auto add = [&](double taken, int now) {
    return stamp(late, 0, nanoseconds(taken), nanoseconds(now));
  };
  constexpr int kNow = 1000;
  CHECK(!add(kNow + 0.01, kNow) && late.arrived == 0);
  CHECK(!add(kNow - kOldest - 0.01, kNow) && late.arrived == 0);
  CHECK(add(kNow - kOldest, kNow) && late.arrived == 1);
  CHECK(add(kNow - 8, kNow));
  CHECK(!add(kNow - 8, kNow + 1) && late.arrived == 0);   // repeated
  CHECK(!add(kNow - 20, kNow + 1) && late.arrived == 0);  // backwards
  CHECK(add(kNow + 1, kNow + 1) && late.age[0] == 0);

  // Without a new one the reading is missing in the end, and comes back with the next.
  CHECK(start(all_stamped(10, 8), late));
  int valid = 0;
  for (int k = 0; k < 200; ++k) {
    Extended q_e = read_at(mechanism, robot, k);
    late.arrived = 0;
    if (k == 150) CHECK(add(k, k));
    CHECK(compensate_latency(robot, late, q_e));
    if (std::isfinite(q_e[4])) ++valid;
  }
  const int longest = 8 + 10 * kDropped;
  CHECK(valid == longest + 1 + 50);
}

TEST_EACH(for_each,
          "late readings of an ideal robot are what it would read now, however old they are") {
  for (const auto& [every, age] : {std::pair{10, 8}, {1, 3}, {7, 0}, {30, kOldest}}) {
    const MultirateSettings settings = all_late(every, age);
    Multirate late;
    CHECK(start(settings, late));
    Bus bus(settings);
    double farthest = 0, held = 0, calmed = 0;
    for (int k = 0; k < 2 * kOldest + 100; ++k) {  // the ring passes its end twice
      const Extended now = read_at(mechanism, robot, k);
      Extended q_e = now;
      late.arrived = bus.deliver(motors, q_e);
      for (int i = 0; i < motors; ++i) CHECK(q_e[i] == now[i]);
      for (int c = motors; c < readings(robot); ++c)
        held = std::max(held, std::fabs(q_e[c] - now[c]));
      CHECK(compensate_latency(robot, late, q_e));
      for (int c = motors; c < readings(robot); ++c)
        farthest = std::max(farthest, std::fabs(q_e[c] - now[c]));
      low_pass(robot, late, q_e);
      for (int c = motors; c < readings(robot); ++c)
        calmed = std::max(calmed, std::fabs(q_e[c] - now[c]));
    }
    CHECK(farthest < 1e-6);
    CHECK(calmed < 1e-6);
    CHECK(held > 1e-5 + 100 * farthest);  // which is not for nothing
  }
}

TEST_EACH(
    for_each,
    "what the geometry has wrong is kept, and a reading is doubted by how far it was carried") {
  if (robot.r == 0) return;
  Robot truth = robot;
  truth.sensor[0].offset += 0.02;
  MultirateSettings settings = all_late(10, 8);
  settings.sensitivity[0].fill(0.1);
  Multirate late;
  CHECK(start(settings, late));
  Bus bus(settings);
  for (int k = 0; k < 400; ++k) {
    const int moving = std::min(k, 200);
    Extended q_e = read_at(mechanism, truth, moving);
    const double now = q_e[motors];
    late.arrived = bus.deliver(motors, q_e);
    CHECK(compensate_latency(robot, late, q_e));
    low_pass(robot, late, q_e);
    CHECK_NEAR(q_e[motors], now, 1e-6);
    Knowledge known;
    known.sigma.fill(1e-5);
    weigh(robot, late, known);
    for (int i = 0; i < motors; ++i) CHECK(known.sigma[i] == 1e-5);
    const Coordinates x = at(mechanism, moving), since = at(mechanism, std::max(0, moving - 18));
    double way = 0;
    for (int i = 0; i < n; ++i) way += (x[i] - since[i]) * (x[i] - since[i]);
    if (k > 50 && k < 200) CHECK(known.sigma[motors] > 0.3 * 0.1 * std::sqrt(way));
    if (k > 50 && k < 200) CHECK(known.sigma[motors] < 0.1 * 10 * std::sqrt(way) + 1e-5);
    if (k == 399) CHECK(known.sigma[motors] < 1.1e-5);  // it has stood still for long
  }
}

TEST_EACH(for_each,
          "motors without a pose for some cycles, and samples that are none, leave no trace") {
  const MultirateSettings settings = all_late(10, 8);
  Multirate late;
  CHECK(start(settings, late));
  Bus bus(settings);
  Extended nothing{};
  nothing.fill(NAN);
  CHECK(!compensate_latency(robot, late, nothing));  // before there is any pose
  CHECK(late.cycle == 0);
  for (int k = 0; k < 200; ++k) {
    const Extended now = read_at(mechanism, robot, k);
    Extended q_e = now;
    if (k >= 60 && k < 65) q_e.fill(NAN);
    late.arrived = bus.deliver(motors, q_e);
    const bool placed = k < 100 || k >= 103;
    if (!placed) std::fill_n(q_e.begin(), motors, NAN);
    CHECK(compensate_latency(robot, late, q_e));
    CHECK(placed == late.placed || k < 100);
    // The picture of cycle 60 arrives in 68 and is held until 78.
    const bool blind = (k >= 68 && k < 78);
    for (int c = motors; c < readings(robot); ++c) {
      CHECK(blind == std::isnan(q_e[c]) || (k >= 60 && k < 65));
      if (!blind && !(k >= 60 && k < 78)) CHECK_NEAR(q_e[c], now[c], placed ? 2e-4 : 2e-3);
    }
  }
}

TEST("a period or an age that is none, or too long, is refused and named") {
  Multirate late;
  for (const auto& [every, age] :
       {std::pair{-1, 0}, {0, -1}, {kSlowest + 1, 0}, {1, kOldest + 1}}) {
    MultirateSettings settings;
    settings.every[3] = every;
    settings.age[3] = age;
    const Outcome outcome = start(settings, late);
    CHECK(outcome.status == Status::no_such_part && outcome.chain == 3);
    CHECK(late.which == 0);
  }
  MultirateSettings settings;
  settings.sensitivity[2][1] = NAN;
  CHECK(!start(settings, late));
  CHECK(start(all_late(kSlowest, kOldest), late));
  CHECK(start(MultirateSettings{}, late));
  CHECK(late.which == 0 && arrivals(late.settings, 0) == 0);
  Extended q_e{};
  Robot robot;
  CHECK(compensate_latency(robot, late, q_e).status == Status::unfinished);
}

TEST_EACH(
    for_each,
    "noise of a late sensor is averaged, and a change beyond its counts is followed at once") {
  Robot robot = mechanism.robot;
  if (robot.r == 0) return;
  constexpr double kSigma = 1e-4;
  constexpr int kEvery = 10, kAge = 8, kCycles = 20000;
  robot.sensor[0].noise = kSigma;
  const MultirateSettings settings = all_late(kEvery, kAge);
  Multirate late;
  CHECK(start(settings, late));
  Bus bus(settings);
  check::Random random(21);
  const Extended rest = read_at(mechanism, robot, 0);
  double noise = 0, squares = 0;
  for (int k = 0; k < kCycles; ++k) {
    Extended q_e = rest;
    if (k % kEvery == 0) noise = std::sqrt(3) * kSigma * random();  // uniform, of variance σ²
    q_e[motors] += noise;
    late.arrived = bus.deliver(motors, q_e);
    CHECK(compensate_latency(robot, late, q_e));
    low_pass(robot, late, q_e);
    if (k > 2000)
      squares += (q_e[motors] - rest[motors]) * (q_e[motors] - rest[motors]) / (kCycles - 2000);
  }
  // Weight a of a sample: variance a / (2 - a) of one sample's, of an average over about 20.
  const double a = 1 - std::pow(1 - kCalmest * (1 - std::exp(-1.0 / (kEvery + kAge))), kEvery);
  const double ratio = squares / (kSigma * kSigma * a / (2 - a));
  CHECK(ratio > 0.7 && ratio < 1.7);

  Extended q_e{};
  for (int k = 0; k < 5 * (kEvery + kAge); ++k) {
    q_e = rest;
    q_e[motors] += 100 * kSigma;
    late.arrived = bus.deliver(motors, q_e);
    CHECK(compensate_latency(robot, late, q_e));
    low_pass(robot, late, q_e);
  }
  CHECK(q_e[motors] - rest[motors] > 95 * kSigma);
}

TEST_EACH(for_each,
          "the stated variance of a late reading is that which the motors' noise gives it") {
  constexpr int kTrials = 1500;
  Robot robot = mechanism.robot;
  if (robot.r == 0) return;
  constexpr double kSigma = 1e-6;
  for (int i = 0; i < motors; ++i) {
    robot.chain[i].encoder_noise = kSigma;
    robot.chain[i].encoder_step = 0;
  }
  robot.sensor[0].step = robot.sensor[0].noise = 0;
  const Extended rest = read_at(mechanism, robot, 0);
  check::Random random(22);
  double mean = 0, squares = 0, stated = 0;
  for (int k = 0; k < kTrials; ++k) {
    Multirate late;
    CHECK(start(all_late(10, 8), late));
    Extended q_e = rest;
    for (int i = 0; i < motors; ++i) q_e[i] += std::sqrt(3) * kSigma * random();
    CHECK(compensate_latency(robot, late, q_e));
    const double off = late.expected[0] - rest[motors];
    mean += off / kTrials;
    squares += off * off / kTrials;
    Knowledge known;
    known.sigma.fill(1e-9);
    low_pass(robot, late, q_e);
    weigh(robot, late, known);
    stated += known.sigma[motors] * known.sigma[motors] / kTrials;
  }
  const double ratio = (squares - mean * mean) / stated;
  CHECK(ratio > 0.85 && ratio < 1.15);  // its own σ is 0.03
}
