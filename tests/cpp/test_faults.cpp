// Simulated faults, and the machine under them.
#include "mechanisms.hpp"
#include "truepose/offline/simulate.hpp"
#include "truepose/offline/statics.hpp"

using namespace mechanisms;

namespace {

constexpr double kNever = std::numeric_limits<double>::infinity();

/// What is read in each of twelve cycles of a reading k + 0.5, another being -k.
std::vector<double> read_of(const std::vector<Fault>& faults, double period = 0.1) {
  FaultyReadings readings(faults, period);
  std::vector<double> read;
  for (int k = 0; k < 12; ++k) {
    Extended q_e{};
    q_e[2] = k + 0.5, q_e[3] = -k;
    readings.read(k * period, q_e);
    read.push_back(q_e[2]);
  }
  return read;
}

}  // namespace

TEST(
    "a reading is faulty from its fault's begin to its end, by what the kind makes of the healthy "
    "one") {
  const std::array<double (*)(int), kFaultTable.size()> lying{
      [](int k) { return k + 2.5; },                    // bias
      [](int k) { return k + 2.5; },                    // jump
      [](int k) { return k == 4 ? 6.5 : k + 0.5; },     // spike
      [](int) { return 4.5; },                          // stuck
      [](int) { return std::nan(""); },                 // dropout
      [](int k) { return k + 0.5 + 0.2 * (k - 4); },    // drift, 2 a second
      [](int k) { return -k - 0.5; },                   // sign
      [](int k) { return 2 * k + 1.0; },                // gain
      [](int k) { return std::max(k - 20, 0) + 0.5; },  // delay, 2 s
      [](int k) { return -1.0 * k; },                   // swap
      [](int k) { return k + 0.5; },                    // noise: random, tested below
      [](int k) { return k % 2 ? k + 1.0 : k * 1.0; },  // coarse, counts of 2
      [](int k) { return k < 24 ? 4.5 : 0; },           // hold, 2 s
      [](int k) { return k + 0.5; },                    // loose: random, tested below
  };
  for (const FaultProperties& row : kFaultTable) {
    if (row.kind == FaultKind::noise || row.kind == FaultKind::loose) continue;
    check::state().scene = row.name;
    for (const double end : {0.7, kNever}) {
      const std::vector<double> read = read_of({{row.kind, 2, 3, 2, 0.4, end, 1}});
      for (int k = 0; k < 12; ++k) {
        const bool faulty = k >= 4 && (k < 7 || end == kNever);
        const double expected = faulty ? lying[static_cast<std::size_t>(row.kind)](k) : k + 0.5;
        CHECK(std::isnan(read[k]) == std::isnan(expected));
        if (!std::isnan(expected)) CHECK_NEAR(read[k], expected, 1e-12);
      }
    }
  }
}

TEST("a late reading is the newest that is old enough, and its memory has an end") {
  for (const double late : {0.1, 0.2, 0.25, 0.3}) {
    const std::vector<double> read = read_of({{FaultKind::delay, 2, 0, late}});
    const int periods = static_cast<int>(std::ceil(late / 0.1 - 1e-9));
    for (int k = 0; k < 12; ++k) CHECK_NEAR(read[k], std::max(k - periods, 0) + 0.5, 0);
  }
  const std::vector<double> read = read_of({{FaultKind::delay, 2, 0, 1e300}});
  for (const double value : read) CHECK_NEAR(value, 0.5, 0);
}

TEST("noise has its sigma, and each value of a held reading lasts as long as stated") {
  FaultyReadings noisy({{FaultKind::noise, 2, 0, 3}}, 1e-3, 7);
  double sum = 0, squares = 0;
  constexpr int kCount = 20000;
  for (int k = 0; k < kCount; ++k) {
    Extended q_e{};
    noisy.read(1e-3 * k, q_e);
    sum += q_e[2], squares += q_e[2] * q_e[2];
  }
  CHECK(std::fabs(sum / kCount) < 0.1);
  CHECK(std::fabs(squares / kCount / 9 - 1) < 0.05);
  const std::vector<double> read = read_of({{FaultKind::hold, 2, 0, 0.3}});
  for (int k = 0; k < 12; ++k) CHECK_NEAR(read[k], k / 3 * 3 + 0.5, 0);
}

TEST("a loose contact reads 0 for one to three cycles, which begin in 5 % of the healthy ones") {
  FaultyReadings loose({{FaultKind::loose, 2, 0, 0}}, 1e-3, 7);
  std::array<int, 4> lasted{};
  int open = 0, healthy = 0;
  for (int k = 0; k < 20000; ++k) {
    Extended q_e{};
    q_e[2] = 0.5;
    loose.read(1e-3 * k, q_e);
    CHECK(q_e[2] == 0 || q_e[2] == 0.5);
    open = q_e[2] == 0 ? open + 1 : 0;
    healthy += open == 0;
    for (int cycles = 1; cycles <= 3; ++cycles) lasted[cycles] += open == cycles;
  }
  CHECK(std::fabs(lasted[1] / (0.05 * healthy) - 1) < 0.1);
  CHECK(std::fabs(1.5 * lasted[2] / lasted[1] - 1) < 0.1);
  CHECK(std::fabs(3.0 * lasted[3] / lasted[1] - 1) < 0.2);
}

TEST("faults act in their order") {
  const Fault bias{FaultKind::bias, 2, 0, 1}, gain{FaultKind::gain, 2, 0, 3};
  CHECK_NEAR(read_of({bias, gain})[5], 3 * 6.5, 1e-12);
  CHECK_NEAR(read_of({gain, bias})[5], 3 * 5.5 + 1, 1e-12);
}

TEST("whatever reading is faulty, the machine goes on, and its torques stay finite and held") {
  for_each([](const Mechanism& mechanism, auto mobility) {
    constexpr Mobility K = mobility();
    const Robot& robot = mechanism.robot;
    check::Random random(12);
    const Joint to = random_pose(mechanism, random);
    for (const Law law : kLaws) {
      ControlSettings settings;
      settings.law = law;
      CHECK(place_poles(robot, robot.home, 100, 1, settings));
      Prior prior(robot);
      const Run run{robot.home, to, 0.05, 0.03, 1};
      for (const FaultProperties& row : kFaultTable)
        for (const int reading : {0, dof(K)}) {
          FaultyReadings faults({{row.kind, reading, 1, 0.02, 0.02}}, settings.period);
          Extras extras{prior.weighing()};
          extras.faults = &faults;
          Joint before{};
          int cycles = 0, held = 0;
          Loop<K> loop(robot, robot, settings, robot.home, run.seed, extras);
          const Outcome outcome = loop.move(run, [&](const Sample& sample) {
            const bool answered = sample.status <= Status::ok;
            CHECK(all_finite(sample.torque, kDof<K>));
            CHECK(answered || sample.torque == before);
            before = sample.torque;
            ++cycles, held += !answered;
          });
          CHECK(outcome ? cycles == 81 : cycles > 20);  // or the plant's end
          if (row.kind == FaultKind::dropout && reading == 0) CHECK(held > 0);
        }
    }
  });
}

TEST("an encoder that overstates its motion settles nearer, one that turns it round nowhere") {
  for_each([](const Mechanism& mechanism, auto mobility) {
    constexpr Mobility K = mobility();
    const Robot& robot = mechanism.robot;
    Extended at_home{};
    CHECK(extended<K>(robot, to_pose<K>(robot.home), at_home));
    for (const double gain : {0.97, 1.03, 1.9}) {  // about home's reading, so that all settle there
      std::vector<Fault> faults{{FaultKind::gain, 0, 0, gain},
                                {FaultKind::bias, 0, 0, (1 - gain) * at_home[0]}};
      FaultyReadings readings(faults, 1e-3);
      Joint wanted = robot.home, x{};
      wanted[0] += 1e-3;
      CHECK(settle<K>(robot, robot, StaticsSettings{}, wanted, x, {}, {}, nullptr, &readings));
      Extended asked{}, found{};
      CHECK(extended<K>(robot, to_pose<K>(wanted), asked));
      CHECK(extended<K>(robot, to_pose<K>(x), found));
      CHECK_NEAR(found[0] - at_home[0], (asked[0] - at_home[0]) / gain, 1e-9);
      for (int i = 1; i < kDof<K>; ++i) CHECK_NEAR(found[i], asked[i], 1e-9);
    }
    FaultyReadings turned({{FaultKind::sign, 0}, {FaultKind::bias, 0, 0, 2 * at_home[0]}}, 1e-3);
    Joint wanted = robot.home, x{};
    wanted[0] += 1e-3;
    CHECK(!settle<K>(robot, robot, StaticsSettings{}, wanted, x, {}, {}, nullptr, &turned));
  });
}
