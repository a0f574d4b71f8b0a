// Simulated faults, and the machine under them.
#include "mechanisms.hpp"
#include "moves.hpp"

using namespace mechanisms;

namespace {

/// What is read in each of twelve cycles of a reading k + 0.5, another being -k.
std::vector<double> read_of(const std::vector<Fault>& faults, double period = 0.1) {
  FaultyReadings readings(faults, period);
  std::vector<double> read;
  for (int k = 0; k < 12; ++k) {
    Extended q_e{};
    q_e[2] = k + 0.5, q_e[3] = -k;
    readings.make_faulty(k * period, q_e);
    read.push_back(q_e[2]);
  }
  return read;
}

}  // namespace

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
    noisy.make_faulty(1e-3 * k, q_e);
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
    loose.make_faulty(1e-3 * k, q_e);
    CHECK(q_e[2] == 0 || q_e[2] == 0.5);
    open = q_e[2] == 0 ? open + 1 : 0;
    healthy += open == 0;
    for (int cycles = 1; cycles <= 3; ++cycles) lasted[cycles] += open == cycles;
  }
  CHECK(std::fabs(lasted[1] / (0.05 * healthy) - 1) < 0.1);
  CHECK(std::fabs(1.5 * lasted[2] / lasted[1] - 1) < 0.1);
  CHECK(std::fabs(3.0 * lasted[3] / lasted[1] - 1) < 0.2);
}

TEST_EACH(for_each,
          "whatever reading is faulty, the machine goes on, and its torques stay finite and held") {
  check::Random random(12);
  const Coordinates to = any_x(random);
  for (const Law law : kLaws) {
    ControlSettings settings;
    settings.law = law;
    CHECK(place_poles(robot, robot.home, 100, 1, settings));
    Prior prior(robot);
    for (const FaultProperties& row : kFaultTable)
      for (const int reading : {0, n}) {
        FaultyReadings faults({{row.kind, reading, 1, 0.02, 0.02}}, settings.period);
        Extras extras{prior.weighing()};
        extras.faults = &faults;
        Joint before{};
        int cycles = 0, held = 0;
        const auto write = [&](const Sample& sample) {
          const bool answered = sample.status <= Status::ok;
          CHECK(all_finite(sample.machine.torque, n));
          CHECK(answered || sample.machine.torque == before);
          before = sample.machine.torque;
          ++cycles, held += !answered;
        };
        const Outcome outcome = run_move(Loop(robot, robot, settings, robot.home, 0, extras), K,
                                         robot.home, to, 0.05, 0.03, write);
        CHECK(outcome ? cycles == 81 : cycles > 20);  // or the plant's end
        if (row.kind == FaultKind::dropout && reading == 0) CHECK(held > 0);
      }
  }
}
