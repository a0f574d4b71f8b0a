// LinuxCNC's components. Without LinuxCNC: their cores.
#include <fstream>
#include <iterator>
#include <limits>
#include <memory>

#include "src/c/fields.hpp"
#include "tests/cpp/mechanisms.hpp"

extern "C" {
#include "../../hal/exchange_core.h"
#include "../../hal/geometry.h"
#include "../../hal/plant_core.h"
#include "../../hal/tej_core.h"
}

using namespace mechanisms;

namespace {

constexpr double kPeriod = 1e-3, kGain = 50, kNaN = std::numeric_limits<double>::quiet_NaN();

truepose_description table_of(const Robot& robot) {
  truepose_description table;
  c::describe(robot, table);
  return table;
}

using Correction = std::array<truepose_real, TRUEPOSE_MOTORS>;
double apart(const Correction& a, const Correction& b) {
  double largest = 0;
  for (std::size_t i = 0; i < a.size(); ++i) largest = std::max(largest, std::fabs(a[i] - b[i]));
  return largest;
}

/// A machine, its last motor's rod 3 mm longer than its controller knows, and drives that follow.
struct Loop {
  explicit Loop(const Robot& robot, double longer = 0.003, Prior* prior = nullptr)
      : n(robot.motors) {
    corrector->table.robot = corrector->table.finest = table_of(robot);
    if (prior) knows(prior->known());
    corrector->table.from = 1;
    const truepose_description& commanded = corrector->table.robot;
    CHECK(truepose_corrector_begin(corrector.get(), &commanded, kPeriod).status == TRUEPOSE_OK);
    truepose_description machine = table_of(robot);
    machine.chain[n - 1].rod += longer;
    truepose_real q[TRUEPOSE_MOTORS];
    CHECK(truepose_ikm(&corrector->model, machine.home, q).status == TRUEPOSE_OK);
    CHECK(truepose_plant_begin(plant.get(), &machine, kPeriod, q).status == TRUEPOSE_OK);
    plant->coarse = 0;
    for (int c = 0; c < kMaxReadings; ++c) plant->absolute[c] = 1;
    std::copy_n(plant->q_e, kMaxReadings, plant->read);
    std::copy_n(q, TRUEPOSE_MOTORS, in.q_d);
    in.enable = in.referenced = in.proven = 1;
    in.blend = 0.2;
    std::fill_n(in.largest, TRUEPOSE_MOTORS, 0.2);
  }
  /// With encoders that count, as the controller knows.
  void counts(double motor, double sensor) {
    for (truepose_description* robot : {&corrector->table.robot, &plant->robot}) {
      for (int i = 0; i < n; ++i) robot->chain[i].encoder_step = motor;
      robot->sensor[0].step = sensor;
    }
    plant->coarse = 1;
  }

  /// @return the largest change of the correction in a cycle, rad or m
  double run(int cycles, const truepose_real* speed = nullptr) {
    double step = 0;
    for (int k = 0; k < cycles; ++k) {
      truepose_real velocity[TRUEPOSE_MOTORS] = {}, before[TRUEPOSE_MOTORS];
      int asks[kMaxReadings] = {};
      const truepose_real none[kMaxReadings] = {};
      for (int i = 0; i < n && speed != nullptr; ++i) in.q_d[i] += kPeriod * speed[i];
      std::copy_n(corrector->correction, TRUEPOSE_MOTORS, before);
      std::copy_n(plant->read, kMaxReadings, in.q_e);
      for (int i = 0; i < n; ++i) in.q_e[i] -= in.zero[i];
      truepose_corrector_cycle(corrector.get(), &in);
      for (int i = 0; i < n; ++i) {
        velocity[i] = kGain * corrector->error[i] + (speed != nullptr ? speed[i] : 0);
        step = std::max(step, std::fabs(corrector->correction[i] - before[i]));
        CHECK(std::isfinite(corrector->error[i]));
      }
      truepose_plant_cycle(plant.get(), in.enable ? velocity : none, fault, size, none, asks);
    }
    return step;
  }
  /// What motion reads of a motor.
  double feedback(int i) const { return in.q_d[i] - corrector->error[i]; }
  /// The drives off: motion takes what it reads for its command; and on again.
  void off(int cycles) {
    for (int k = 0; k <= cycles; ++k) {
      in.enable = k == cycles;
      for (int i = 0; i < n; ++i) in.q_d[i] = feedback(i);
      run(1);
    }
  }
  /// Motion homes all motors where they are, said to be q.
  void home(const Correction& q) {
    for (int i = 0; i < n; ++i) {
      in.zero[i] += feedback(i) - q[i];
      in.q_d[i] = q[i];
    }
  }
  Correction correction() const {
    Correction now;
    std::copy_n(corrector->correction, now.size(), now.begin());
    return now;
  }
  double largest_correction() const { return apart(correction(), {}); }

  void knows(const Knowledge& known) {
    truepose_table& table = corrector->table;
    table.monitored = 1;
    table.known.count = known.count;
    table.known.column = table.column;
    table.known.root = table.root;
    std::copy_n(known.column, known.count, table.column);
    std::copy_n(known.root, known.count * known.count, table.root);
    std::copy_n(known.sigma.begin(), kMaxReadings, table.known.sigma);
    table.monitor = c::converted<truepose_fault_monitor_settings>(FaultMonitorSettings{});
  }

  /// To a pose, in so many cycles. @return as run()
  double go(const Coordinates& x, int cycles = 200) {
    truepose_real q[TRUEPOSE_MOTORS] = {}, speed[TRUEPOSE_MOTORS] = {};
    CHECK(truepose_ikm(&corrector->commanded, x.data(), q).status == TRUEPOSE_OK);
    for (int i = 0; i < n; ++i) speed[i] = (q[i] - in.q_d[i]) / (cycles * kPeriod);
    return run(cycles, speed);
  }
  /// How far what a robot makes of the motors is from the true pose, m or rad.
  double off(const truepose_model& robot) const {
    truepose_real x[6];
    std::copy_n(plant->x, 6, x);
    CHECK(truepose_fkm(&robot, plant->read, 12, x).outcome.status == TRUEPOSE_OK);
    double sum = 0;
    for (int i = 0; i < n; ++i) sum = std::max(sum, std::fabs(x[i] - plant->x[i]));
    return sum;
  }

  int n;
  std::unique_ptr<truepose_corrector> corrector = std::make_unique<truepose_corrector>();
  std::unique_ptr<truepose_plant> plant = std::make_unique<truepose_plant>();
  truepose_corrector_input in{};
  int32_t fault[kMaxReadings] = {};
  truepose_real size[kMaxReadings] = {};
};

using Bytes = std::vector<unsigned char>;
/// The bytes of a machine's own table, changed.
template <class Change>
Bytes bytes_of(const Loop& loop, Change change) {
  const auto table = std::make_unique<truepose_table>(loop.corrector->table);
  table->known.column = table->column;
  table->known.root = table->root;
  change(*table);
  const char* const path = "given.table";
  CHECK(truepose_write_table(path, table.get()) == nullptr);
  std::ifstream file(path, std::ios::binary);
  Bytes bytes{std::istreambuf_iterator<char>(file), {}};
  std::remove(path);
  return bytes;
}

/// A machine whose controller takes geometry while it runs.
struct Exchange : Loop {
  Exchange(const Robot& robot, double longer, Prior& prior) : Loop(robot, longer, &prior) {
    truepose_exchange_begin(exchange.get());
    in.learnt = 1;
    in.chi2 = 15.1;
  }
  /// @return the largest change of the correction in a cycle, rad or m
  double give(const Bytes& bytes, int cycles = 20, const truepose_real* speed = nullptr) {
    double step = 0;
    for (std::size_t k = 0; k < bytes.size() || cycles-- > 0; k += 1000) {
      const std::size_t count =
          k < bytes.size() ? std::min<std::size_t>(1000, bytes.size() - k) : 0;
      step = std::max(step, run(1, speed));
      truepose_exchange_cycle(exchange.get(), bytes.data() + k, count, corrector.get(), &in);
    }
    return step;
  }
  std::unique_ptr<truepose_exchange> exchange = std::make_unique<truepose_exchange>();
};

/// What a ramp of 0.2 s over a correction moves in a cycle: its quintic's steepest part.
double ramp(double correction) { return 1.875 * correction * kPeriod / 0.2; }

}  // namespace

TEST("joints of a pose lead back to it, in machine units, and other axes pass") {
  check::Random random(1);
  for_each_square([&](const Mechanism& mechanism) {
    const auto kins = std::make_unique<truepose_kins>();
    const truepose_description table = table_of(mechanism.robot);
    const bool square = mechanism.robot.motors == dof(mechanism.robot.mobility);
    CHECK(truepose_kins_load(kins.get(), &table, 0.001).status ==
          (square ? TRUEPOSE_OK : TRUEPOSE_NOT_SQUARE));
    if (!square) return;
    CHECK(truepose_kins_extras(kins.get(), "w"));
    CHECK(!truepose_kins_extras(kins.get(), "x"));
    CHECK(!truepose_kins_extras(kins.get(), "ww"));
    CHECK(truepose_kins_extras(kins.get(), "w"));
    for (int k = 0; k < 20; ++k) {
      const Coordinates x = random_pose(mechanism, random, 0.5);
      truepose_real q[TRUEPOSE_MOTORS], axes[9] = {}, joints[9] = {}, found[9] = {};
      CHECK(truepose_ikm(&kins->model, x.data(), q).status == TRUEPOSE_OK);
      for (int i = 0; i < kins->motors; ++i) joints[i] = q[i] / kins->scale[i];
      joints[kins->motors] = 7;
      CHECK(truepose_kins_forward(kins.get(), joints, axes) <= TRUEPOSE_OK);
      CHECK(axes[8] == 7);
      CHECK(truepose_kins_inverse(kins.get(), axes, found) <= TRUEPOSE_OK);
      for (int i = 0; i <= kins->motors; ++i) CHECK_NEAR(found[i], joints[i], 1e-8);
      axes[0] = kNaN;
      CHECK(truepose_kins_inverse(kins.get(), axes, found) == TRUEPOSE_NOT_FINITE);
      CHECK(kins->refusal.status == TRUEPOSE_NOT_FINITE && std::isnan(kins->refused[0]));
      for (int i = 0; i <= kins->motors; ++i) CHECK_NEAR(found[i], joints[i], 1e-8);
    }
    CHECK(kins->conditioning > 0);
    kins->least_conditioning = 1;
    truepose_real axes[9] = {}, joints[9];
    axes[0] = 1000 * table.home[0], axes[1] = 1000 * table.home[1], axes[2] = 1000 * table.home[2];
    CHECK(truepose_kins_inverse(kins.get(), axes, joints) > TRUEPOSE_OK);
  });
}

TEST("the forward model starts from the axes it is given, wherever the robot was before") {
  check::Random random(4);
  for_each_square([&](const Mechanism& mechanism) {
    const auto kins = std::make_unique<truepose_kins>();
    const truepose_description table = table_of(mechanism.robot);
    const bool square = mechanism.robot.motors == dof(mechanism.robot.mobility);
    CHECK(truepose_kins_load(kins.get(), &table, 0.001).status ==
          (square ? TRUEPOSE_OK : TRUEPOSE_NOT_SQUARE));
    if (!square) return;
    for (int k = 0; k < 100; ++k) {
      const Coordinates x = random_pose(mechanism, random, 1.0);
      truepose_real q[TRUEPOSE_MOTORS], joints[9] = {}, axes[9] = {}, near[9];
      if (truepose_ikm(&kins->model, x.data(), q).status > TRUEPOSE_OK) continue;
      for (int i = 0; i < kins->motors; ++i) joints[i] = q[i] / kins->scale[i];
      std::copy_n(x.data(), 6, kins->guess);  // this is where it is
      CHECK(truepose_kins_forward(kins.get(), joints, axes) <= TRUEPOSE_OK);
      std::copy_n(random_pose(mechanism, random, 1.0).data(), 6, kins->guess);
      for (int i = 0; i < 9; ++i) near[i] = axes[i] == 0 ? 0 : axes[i] + 0.01 * random();
      CHECK(truepose_kins_forward(kins.get(), joints, near) <= TRUEPOSE_OK);
      CHECK(kins->iterations <= 4);
      for (int i = 0; i < 6; ++i) CHECK_NEAR(near[i], axes[i], 1e-7);
    }
    truepose_real axes[9] = {}, joints[9] = {};
    joints[0] = kNaN;
    CHECK(truepose_kins_forward(kins.get(), joints, axes) > TRUEPOSE_OK);
    CHECK(kins->refusal.status == kins->outcome.status);
    const auto refusal = kins->refusal;
    for (int i = 0; i < 9; ++i) axes[i] = 0;
    std::copy_n(table.home, 6, kins->guess);
    truepose_real q[TRUEPOSE_MOTORS];
    CHECK(truepose_ikm(&kins->model, table.home, q).status == TRUEPOSE_OK);
    for (int i = 0; i < kins->motors; ++i) joints[i] = q[i] / kins->scale[i];
    CHECK(truepose_kins_forward(kins.get(), joints, axes) <= TRUEPOSE_OK);
    CHECK(kins->refusal.status == refusal.status);  // the latest refusal stays
  });
}

TEST("under a law of redundant sensors the pose that they see is right, and no motor jumps") {
  const Mechanism mechanism = h4();
  for (const int law : {TRUEPOSE_LAW_TEJ, TRUEPOSE_LAW_CARTESIAN}) {
    Loop loop(mechanism.robot);
    loop.run(500);
    const double by_motors = std::fabs(loop.plant->x[3] - mechanism.robot.home[3]);
    CHECK(loop.largest_correction() == 0);
    loop.in.law = law;
    const double step = loop.run(1000);
    CHECK(loop.corrector->law == law && loop.corrector->fault == 0);
    CHECK(by_motors > 1e-3);
    CHECK(std::fabs(loop.plant->x[3] - mechanism.robot.home[3]) < by_motors / 8);
    CHECK(loop.largest_correction() > 1e-3);
    CHECK(step < 1.2 * ramp(loop.largest_correction()));
    truepose_servo_cycle cycle;  // at rest: the law's own error of these readings
    CHECK(truepose_servo(&loop.corrector->model, law, 0, loop.corrector->x_d, loop.plant->read,
                         nullptr, nullptr, &cycle)
              .status == TRUEPOSE_OK);
    for (const truepose_real error : cycle.error) CHECK_NEAR(error, 0, 1e-9);
  }
}

TEST("off and on again, and from law to law, motors follow without a step") {
  Loop loop(h4().robot);
  loop.in.law = TRUEPOSE_LAW_TEJ;
  loop.run(1000);
  const double most = 1.2 * ramp(loop.largest_correction());
  const Correction before = loop.correction();
  loop.off(50);
  CHECK(apart(before, loop.correction()) < 1e-9);  // it is held
  CHECK(loop.run(1000) < most);
  loop.in.law = TRUEPOSE_LAW_CARTESIAN;
  CHECK(loop.run(100) < most);
  loop.in.law = TRUEPOSE_LAW_JOINT;  // while the change before is under way
  CHECK(loop.run(100) < most);
  loop.in.law = TRUEPOSE_LAW_TEJ;
  CHECK(loop.run(1000) < most);
}

TEST("off and on again twenty times, the platform stays where it is") {
  for (const bool counts : {false, true})
    for (const int law : {TRUEPOSE_LAW_TEJ, TRUEPOSE_LAW_CARTESIAN}) {
      constexpr double kCount = 4.4e-4, kTheta = 1.1e-4;
      Loop loop(h4().robot);
      if (counts) loop.counts(kCount, kTheta);
      loop.in.law = law;
      loop.go({0.05, 0.05, -0.42, 0.17});
      loop.run(1500);
      const auto was = std::to_array(loop.plant->x);
      CHECK(loop.largest_correction() > 1e-3);
      for (int k = 0; k < 20; ++k) {
        const Correction commanded = std::to_array(loop.in.q_d);
        loop.off(20 + k);
        CHECK(apart(commanded, std::to_array(loop.in.q_d)) < 1e-7);
        CHECK(loop.largest_correction() > 1e-3);
        loop.run(400);
        CHECK(loop.corrector->fault == 0 && loop.corrector->law == law);
        CHECK(std::fabs(loop.plant->x[3] - was[3]) < (counts ? kTheta : 1e-7));
        for (int i = 0; i < 3; ++i)
          CHECK(std::fabs(loop.plant->x[i] - was[i]) < (counts ? 1e-4 : 1e-7));
        for (int i = 0; i < loop.n && !counts; ++i)  // and this is what pins say
          CHECK_NEAR(loop.corrector->pose[i], loop.corrector->x_d[i], 1e-7);
      }
    }
}

TEST("motors that move while off are seen by motion, and are not pulled back") {
  Loop loop(h4().robot);
  loop.in.law = TRUEPOSE_LAW_TEJ;
  loop.run(1000);
  loop.off(10);
  loop.in.enable = 0;
  const truepose_real speed[TRUEPOSE_MOTORS] = {0.2, 0.2, 0.2, 0.2}, none[kMaxReadings] = {};
  int asks[kMaxReadings] = {};
  for (int k = 0; k < 100; ++k) {  // by hand
    for (int i = 0; i < loop.n; ++i) loop.in.q_d[i] = loop.feedback(i);
    truepose_plant_cycle(loop.plant.get(), speed, loop.fault, none, none, asks);
    loop.run(1);
  }
  const auto was = std::to_array(loop.plant->x);
  loop.off(5);
  loop.run(1000);
  for (int i = 0; i < 3; ++i) CHECK(std::fabs(loop.plant->x[i] - was[i]) < 5e-4);
}

TEST("homed where it does not belong, a robot is questioned before the law engages") {
  const Mechanism mechanism = h4();
  for (const bool right : {true, false}) {
    Prior prior(mechanism.robot);
    Loop loop(mechanism.robot, 5e-4, &prior);
    loop.in.law = TRUEPOSE_LAW_TEJ;
    loop.in.monitor = 1;
    loop.in.chi2 = 15.1;
    loop.go({0.03, 0, mechanism.robot.home[2], 0.2});
    loop.run(1000);
    CHECK(loop.corrector->fault == 0 && loop.corrector->law == TRUEPOSE_LAW_TEJ);
    Correction q{};
    CHECK(truepose_ikm(&loop.corrector->model, mechanism.robot.home.data(), q.data()).status ==
          TRUEPOSE_OK);
    if (right) std::copy_n(loop.plant->q, loop.n, q.begin());
    loop.home(q);
    const Correction error = std::to_array(loop.corrector->error);
    loop.run(1);
    CHECK_NEAR(apart(error, std::to_array(loop.corrector->error)), 0, 1e-6);  // no drive steps
    loop.run(600);
    CHECK((loop.corrector->pupil.chi2 < loop.in.chi2) == right);
    const int fault = right ? TRUEPOSE_TEJ_NO_FAULT : TRUEPOSE_TEJ_HOMING;
    CHECK(loop.corrector->fault == fault);
    CHECK(loop.corrector->law == (right ? TRUEPOSE_LAW_TEJ : TRUEPOSE_LAW_JOINT));
    loop.off(20);
    loop.run(100);
    CHECK(loop.corrector->fault == fault);  // off and on is no answer
    CHECK(loop.corrector->reason.status == (right ? TRUEPOSE_OK : TRUEPOSE_DISAGREE));
    loop.in.monitor = 0;
    loop.in.reset = 1;  // somebody's is
    loop.run(1);
    loop.in.reset = 0;
    loop.run(300);
    CHECK(loop.corrector->fault == 0 && loop.corrector->law == TRUEPOSE_LAW_TEJ);
  }
}

TEST("a reading without a number is the one that is named, monitored or not") {
  for (const int monitor : {0, 1})
    for (int c = 0; c < 5; ++c) {
      Prior prior(h4().robot);
      Loop loop(h4().robot, 0.0, &prior);
      loop.in.law = TRUEPOSE_LAW_TEJ;
      loop.in.monitor = monitor;
      loop.run(300);
      loop.fault[c] = TRUEPOSE_PLANT_MISSING;
      loop.run(300);
      const truepose_corrector& tej = *loop.corrector;
      CHECK(tej.lost == (c < loop.n ? 1U << c : 0));
      for (int other = 0; other < 5; ++other)
        CHECK(tej.symptom[other] == (monitor && other == c ? TRUEPOSE_MISSING : 0));
      if (tej.fault != 0) CHECK(tej.reason.part == c);
      CHECK(monitor ? tej.left_out == 1U << c : tej.fault == TRUEPOSE_TEJ_READING);
      loop.fault[c] = TRUEPOSE_PLANT_HEALTHY;
      loop.off(5);
      loop.run(50);
      CHECK(tej.fault == 0);
      CHECK(tej.symptom[c] == (monitor ? TRUEPOSE_MISSING : 0));  // why stays until reset
      loop.in.reset = 1;
      loop.run(1);
      CHECK(tej.symptom[c] == 0 && tej.reason.status == TRUEPOSE_OK);
    }
}

TEST("a sensor that stops is said, and what it corrected is held and ramped out") {
  Loop loop(h4().robot);
  loop.in.law = TRUEPOSE_LAW_TEJ;
  loop.run(1000);
  const double correction = loop.largest_correction();
  const truepose_real speed[TRUEPOSE_MOTORS] = {0.1, 0.1, 0.1, 0.1};
  loop.fault[loop.n] = TRUEPOSE_PLANT_MISSING;
  CHECK(loop.run(100, speed) < 1.2 * ramp(correction));
  CHECK(loop.corrector->fault == TRUEPOSE_TEJ_READING);
  CHECK(loop.corrector->law == TRUEPOSE_LAW_JOINT);
  CHECK(loop.largest_correction() > correction / 4);  // half way
  loop.run(150, speed);
  CHECK(loop.largest_correction() == 0);
  loop.fault[loop.n] = TRUEPOSE_PLANT_HEALTHY;
  loop.run(10);
  CHECK(loop.corrector->fault == TRUEPOSE_TEJ_READING);  // until somebody says otherwise
  loop.in.reset = 1;
  loop.run(1);
  loop.in.reset = 0;
  CHECK(loop.run(400) < 1.2 * ramp(correction));
  CHECK(loop.corrector->fault == 0 && loop.corrector->law == TRUEPOSE_LAW_TEJ);
}

TEST("a monitored sensor ends the law before its lie reaches a drive") {
  for (const int lie : {TRUEPOSE_PLANT_MISSING, TRUEPOSE_PLANT_JUMPED}) {
    double worst[2];
    for (const int monitor : {0, 1}) {
      Prior prior(h4().robot);
      Loop loop(h4().robot, 0.0, &prior);
      loop.in.law = TRUEPOSE_LAW_TEJ;
      loop.in.monitor = monitor;
      loop.run(300);
      CHECK(loop.corrector->fault == 0 && loop.corrector->law == TRUEPOSE_LAW_TEJ);
      loop.fault[loop.n] = lie;
      loop.size[loop.n] = 0.05;
      worst[monitor] = 0;
      for (int k = 0; k < 300; ++k) {
        loop.run(1);
        worst[monitor] = std::max(worst[monitor], loop.largest_correction());
      }
      if (monitor) CHECK(loop.corrector->fault == TRUEPOSE_TEJ_MONITOR && loop.corrector->law == 0);
    }
    CHECK(worst[1] < 1e-3);
    CHECK(lie == TRUEPOSE_PLANT_MISSING || worst[0] > 3e-3);
  }
}

TEST("of encoders the one that freezes in mid-move is named, and no motor that a law led astray") {
  constexpr double kCount = 4.4e-4, kTheta = 1.1e-4;
  check::Random random(5);
  const Mechanism mechanism = h4();
  Prior prior(mechanism.robot);
  double turned = 0;
  for (int k = 0; k < 40; ++k) {
    const int frozen = k % 5;
    Loop loop(mechanism.robot, 0.001, &prior);
    truepose_fault_monitor_settings& monitor = loop.corrector->table.monitor;
    loop.counts(kCount, kTheta);
    for (int c = 0; c <= loop.n; ++c) {
      loop.corrector->table.known.sigma[c] = c < loop.n ? kCount : kTheta;
      monitor.moved[c] = 8 * (c < loop.n ? kCount : kTheta);
    }
    std::fill_n(monitor.kp, loop.n, 150 * 150), std::fill_n(monitor.kd, loop.n, 2 * 150);
    std::fill_n(monitor.rests, loop.n, 1.5 * kCount);
    loop.in.law = k % 2 ? TRUEPOSE_LAW_TEJ : TRUEPOSE_LAW_ESTIMATED;
    loop.in.monitor = 1;
    Coordinates x = random_pose(mechanism, random, 0.5);
    loop.go(x, 300);  // fast
    loop.run(300);
    CHECK(loop.corrector->left_out == 0 && loop.corrector->fault == 0);
    for (int j = 0; j < 3; ++j) x[j] += 0.03 * random();
    x[3] -= std::copysign(0.3, x[3]);
    truepose_real q[TRUEPOSE_MOTORS] = {}, speed[TRUEPOSE_MOTORS] = {};
    CHECK(truepose_ikm(&loop.corrector->commanded, x.data(), q).status == TRUEPOSE_OK);
    for (int i = 0; i < loop.n; ++i) speed[i] = (q[i] - loop.in.q_d[i]) / 1.5;
    loop.run(500, speed);
    loop.fault[frozen] = TRUEPOSE_PLANT_FROZEN;
    for (int cycle = 0; cycle < 800; ++cycle) {
      loop.run(1, speed);
      if (frozen < loop.n) continue;
      const truepose_model& commanded = loop.corrector->commanded;
      CHECK(truepose_fkm(&commanded, loop.in.q_d, 12, x.data()).outcome.status == TRUEPOSE_OK);
      turned = std::max(turned, std::fabs(loop.plant->x[3] - x[3]));
    }
    CHECK(loop.corrector->left_out == 1U << frozen);
    CHECK(loop.corrector->symptom[frozen] == TRUEPOSE_STUCK);
  }
  std::printf("  θ at most %.1f mrad off\n", 1e3 * turned);
  CHECK(turned < 0.03);
}

TEST("of two sensors the faulty one is left out, and the law goes on without a step") {
  Robot robot = h4().robot;
  robot.r = 2;
  CHECK(bool(finish(robot)));
  for (const int law : {TRUEPOSE_LAW_TEJ, TRUEPOSE_LAW_ESTIMATED})
    for (const int lie : {TRUEPOSE_PLANT_MISSING, TRUEPOSE_PLANT_JUMPED}) {
      Prior prior(robot);
      Loop loop(robot, 1e-4, &prior);
      loop.in.law = law;
      loop.in.monitor = 1;
      loop.run(1000);
      CHECK(loop.corrector->fault == 0 && loop.corrector->law == law);
      const Correction before = loop.correction();
      loop.fault[loop.n + 1] = lie;
      loop.size[loop.n + 1] = 0.05;
      const double step = loop.run(400);
      CHECK(loop.corrector->left_out == 1U << (loop.n + 1));
      CHECK(loop.corrector->fault == 0 && loop.corrector->law == law);
      CHECK(step < 1.2 * ramp(apart(before, loop.correction())) + 1e-9);
      // What is left is the law of the sensor that is left: as if there had been no other.
      Robot other = robot;
      other.r = 1;
      CHECK(bool(finish(other)));
      Prior alone(other);
      Loop without(other, 1e-4, &alone);
      without.in.law = law;
      without.run(1400);
      CHECK(std::fabs(loop.plant->x[3] - without.plant->x[3]) < 2e-5);
      loop.fault[loop.n] = lie;  // the other one as well: nothing can stand for it
      loop.size[loop.n] = 0.05;
      CHECK(loop.run(400) < 1.2 * ramp(apart({}, without.correction())) + 1e-9);
      CHECK(loop.corrector->fault == TRUEPOSE_TEJ_MONITOR && loop.corrector->law == 0);
    }
}

TEST("at rest the robot is learnt, the law goes by it without a step, and it can be kept") {
  const Mechanism mechanism = h4();
  for (const int law : {TRUEPOSE_LAW_TEJ, TRUEPOSE_LAW_ESTIMATED}) {
    check::Random random(3);
    Prior prior(mechanism.robot);
    Loop loop(mechanism.robot, 5e-4, &prior);
    const truepose_pupil& pupil = loop.corrector->pupil;
    loop.in.law = law;
    loop.in.learn = loop.in.learnt = 1;
    loop.in.rest = 0.25;
    double drawn = 0, learnt = 0;
    for (int k = 0; k < 40; ++k) {
      const auto lines = pupil.lines;
      loop.go(random_pose(mechanism, random));
      CHECK(pupil.lines == lines);  // not in motion
      loop.run(200);
      const Correction before = loop.correction();
      const double step = loop.run(400);
      CHECK(step < 1.2 * ramp(apart(before, loop.correction())) + 1e-10);
      if (k < 30) continue;
      drawn = std::max(drawn, loop.off(loop.corrector->model));
      learnt = std::max(learnt, loop.off(pupil.robot));
    }
    CHECK(loop.corrector->fault == 0 && loop.corrector->law == law);
    CHECK(pupil.lines >= 40 && pupil.left_out == 0 && pupil.outcome.status == TRUEPOSE_OK);
    CHECK(learnt < drawn / 5);
    for (int i = 0; i < loop.n; ++i) CHECK(pupil.sigma[i] > 0 && pupil.sigma[i] < 1e-3);

    const Correction by_learnt = loop.correction();
    loop.in.learn = loop.in.learnt = 0;  // the robot as it was exported, and back
    const double most = 1.2 * (loop.run(1), ramp(loop.largest_correction())) + 1e-6;
    CHECK(loop.run(600) < most);
    CHECK(apart(by_learnt, loop.correction()) > 1e-5);
    loop.in.learnt = 1;
    CHECK(loop.run(600) < most);
    CHECK(apart(by_learnt, loop.correction()) < 1e-6);

    const char* const path = "learnt.table";
    CHECK(truepose_pupil_keep(&pupil, &loop.corrector->table, path) == nullptr);
    const auto again = std::make_unique<truepose_corrector>();
    CHECK(truepose_read_table(path, &again->table) == nullptr);
    CHECK(again->table.from == loop.corrector->table.from);
    const truepose_description commanded = table_of(mechanism.robot);
    CHECK(truepose_corrector_begin(again.get(), &commanded, kPeriod).status == TRUEPOSE_OK);
    CHECK_NEAR(loop.off(again->model), loop.off(pupil.robot), 1e-12);
    CHECK(again->table.root[0] < prior.known().root[0]);
    std::remove(path);
  }
}

TEST("geometry that arrives is used without a jump: a tenth of a count a cycle") {
  constexpr double kCount = 4.4e-4, kTheta = 1.1e-4, kLonger = 0.003;
  const Mechanism mechanism = h4();
  for (const int law :
       {TRUEPOSE_LAW_TEJ, TRUEPOSE_LAW_CARTESIAN, TRUEPOSE_LAW_WEIGHTED, TRUEPOSE_LAW_ESTIMATED})
    for (const bool counts : {false, true}) {
      Prior prior(mechanism.robot);
      Exchange loop(mechanism.robot, kLonger, prior);
      loop.counts(kCount, kTheta);
      for (int c = 0; c <= loop.n; ++c)
        loop.corrector->table.known.sigma[c] = c < loop.n ? kCount : kTheta;
      loop.plant->coarse = counts;
      loop.in.law = law;
      loop.go({0.05, 0.05, -0.42, 0.2});
      loop.run(1000);
      const double dither = loop.run(500);
      const Correction before = loop.correction();
      const Bytes bytes = bytes_of(loop, [&](truepose_table& table) {
        for (truepose_description* robot : {&table.robot, &table.finest})
          robot->chain[loop.n - 1].rod += kLonger;
        const int p = table.known.count;
        for (int k = 0; k < p * p; ++k) table.root[k] /= 100;
      });
      const double step = loop.give(bytes, 4000);
      CHECK(loop.exchange->state == TRUEPOSE_EXCHANGE_USED && loop.exchange->used == 1);
      CHECK(loop.corrector->fault == 0 && loop.corrector->law == law);
      CHECK(apart(before, loop.correction()) > 5 * kCount);
      if (!counts) CHECK(dither < 1e-9 && step <= 0.1 * kCount + 1e-9);
      if (counts) CHECK(step < 1.1 * dither + 0.1 * kCount);
      Coordinates x{0.05, 0.05, -0.42, 0.2};
      for (int i = 0; i < loop.n && !counts; ++i) CHECK_NEAR(loop.plant->x[i], x[i], 1e-7);
      loop.in.learnt = 0;  // back to the exported robot
      CHECK(loop.give({}, 4000) < (counts ? 1.1 * dither : 0) + 0.1 * kCount + 1e-9);
      if (!counts && law < TRUEPOSE_LAW_WEIGHTED) CHECK(apart(before, loop.correction()) < 1e-8);
      loop.in.learnt = 1;
      loop.in.learn = 1;  // its own calibration began from another robot: it stays off
      loop.in.rest = 0.05;
      loop.give({}, 4000);
      CHECK(loop.corrector->pupil.lines == 0);
      for (int i = 0; i < loop.n && !counts; ++i) CHECK_NEAR(loop.plant->x[i], x[i], 1e-7);
    }
}

TEST("geometry that is no good is refused, and the last good one stays") {
  const Mechanism mechanism = h4();
  Prior prior(mechanism.robot);
  Exchange loop(mechanism.robot, 5e-4, prior);
  truepose_exchange& exchange = *loop.exchange;
  loop.in.law = TRUEPOSE_LAW_WEIGHTED;
  loop.run(1000);
  const auto surely = [](truepose_table& table) {
    for (int k = 0; k < table.known.count * table.known.count; ++k) table.root[k] /= 1e4;
  };
  const auto right = [&](truepose_table& table) {
    surely(table);
    table.finest.chain[loop.n - 1].rod += 5e-4;
  };
  loop.give(bytes_of(loop, right), 1000);
  CHECK(exchange.used == 1);
  const Correction good = loop.correction();
  const auto refused = [&](const Bytes& bytes) {
    const double step = loop.give(bytes, 2 * 1000);
    CHECK(exchange.used == 1 && step < 1e-9 && apart(good, loop.correction()) < 1e-9);
    CHECK(loop.corrector->fault == 0 && loop.corrector->law == TRUEPOSE_LAW_WEIGHTED);
    CHECK(exchange.why != nullptr);
    return exchange.state;
  };
  const auto changed = [&](auto change) {
    return refused(bytes_of(loop, [&](truepose_table& table) {
      right(table);
      change(table);
    }));
  };
  const Bytes bytes = bytes_of(loop, right);
  for (const std::size_t count : {std::size_t{3}, std::size_t{2000}, bytes.size() - 1})
    CHECK(refused(Bytes(bytes.begin(), bytes.begin() + count)) == TRUEPOSE_EXCHANGE_INVALID);
  for (std::size_t at = 0; at < bytes.size(); at += bytes.size() / 13) {
    Bytes damaged = bytes;
    damaged[at] ^= 1;
    CHECK(refused(damaged) == TRUEPOSE_EXCHANGE_INVALID);
  }
  using Table = truepose_table;
  CHECK(changed([](Table& table) { table.finest.chain[1].rod = kNaN; }) ==
        TRUEPOSE_EXCHANGE_INVALID);
  CHECK(changed([](Table& table) { table.finest.chain[1].rod = 9; }) == TRUEPOSE_EXCHANGE_INVALID);
  CHECK(changed([](Table& table) { table.robot.abi = 1, table.finest.abi = 1; }) ==
        TRUEPOSE_EXCHANGE_INVALID);
  CHECK(changed([](Table& table) { table.name[0] = 'x'; }) == TRUEPOSE_EXCHANGE_OTHER);
  CHECK(changed([](Table& table) { table.finest.sensor[0].kind = TRUEPOSE_COORDINATE; }) ==
        TRUEPOSE_EXCHANGE_OTHER);
  CHECK(changed([](Table& table) { table.finest.sensors = 0; }) == TRUEPOSE_EXCHANGE_OTHER);
  CHECK(changed([](Table& table) { table.root[0] = kNaN; }) == TRUEPOSE_EXCHANGE_READINGS);
  CHECK(changed([](Table& table) { table.known.sigma[4] = kNaN; }) == TRUEPOSE_EXCHANGE_READINGS);
  CHECK(changed([](Table& table) { table.column[0] = 5000; }) == TRUEPOSE_EXCHANGE_READINGS);
  CHECK(changed([](Table& table) { table.finest.chain[2].rod += 1e-3; }) ==
        TRUEPOSE_EXCHANGE_READINGS);
  std::fill_n(loop.in.largest, TRUEPOSE_MOTORS, 1.01 * loop.largest_correction());
  CHECK(changed([](Table& table) {
          for (truepose_chain& chain : table.finest.chain) chain.rod += 5e-3;
        }) == TRUEPOSE_EXCHANGE_CORRECTION);
  std::fill_n(loop.in.largest, TRUEPOSE_MOTORS, 0.2);
  loop.in.learn = 1;
  CHECK(refused(bytes) == TRUEPOSE_EXCHANGE_LEARNS);
  loop.in.learn = 0;
  // One that waits for valid readings is replaced by a newer one.
  loop.fault[loop.n] = TRUEPOSE_PLANT_MISSING;
  loop.give(bytes, 100);
  CHECK(exchange.state == TRUEPOSE_EXCHANGE_TESTED && exchange.used == 1);
  loop.fault[loop.n] = TRUEPOSE_PLANT_HEALTHY;
  loop.run(10);
  loop.in.reset = 1;
  loop.run(1);
  loop.in.reset = 0;
  Bytes two = bytes;
  const Bytes other = bytes_of(loop, [&](Table& table) {
    right(table);
    table.name[1] = 'x';
  });
  two.insert(two.begin(), other.begin(), other.end());
  loop.give(two, 1000);
  CHECK(exchange.state == TRUEPOSE_EXCHANGE_USED && exchange.used == 2);
  CHECK(apart(good, loop.correction()) < 1e-9);
}

TEST("memory holds what the largest robot learns, as many parameters as a table has") {
  Robot robot = hexapod("hexapod", Actuator::telescopic).robot;
  std::fill(robot.sensor.begin(), robot.sensor.end(), robot.sensor[1]);
  robot.r = kMaxSensors;
  const truepose_description table = table_of(robot);
  truepose_model model;
  CHECK(truepose_load(&model, sizeof model, &table).status == TRUEPOSE_OK);
  CHECK(truepose_work(&model, TRUEPOSE_TABLE_PARAMETERS) > 0);
  CHECK(truepose_work(&model, TRUEPOSE_TABLE_PARAMETERS) <= TRUEPOSE_TEJ_WORK);
  CHECK(truepose_online_calibrator_memory(&model, TRUEPOSE_TABLE_PARAMETERS) <= TRUEPOSE_LEARNS);
}

TEST("nothing is learnt that should not be") {
  const Mechanism mechanism = h4();
  const auto learns = [&](auto spoil) {
    Prior prior(mechanism.robot);
    Loop loop(mechanism.robot, 5e-4, &prior);
    loop.in.learn = loop.in.learnt = 1;
    loop.in.rest = 0.1;
    spoil(loop);
    loop.run(500);
    CHECK(loop.corrector->learnt == 1 && loop.largest_correction() == 0);  // the joint law
    return loop.corrector->pupil.lines + loop.corrector->pupil.left_out;
  };
  CHECK(learns([](Loop&) {}) == 1);  // what is the same again is no news
  CHECK(learns([](Loop& loop) { loop.in.learn = 0; }) == 0);
  CHECK(learns([](Loop& loop) { loop.in.referenced = 0; }) == 0);
  CHECK(learns([](Loop& loop) { loop.fault[loop.n] = TRUEPOSE_PLANT_MISSING; }) == 0);
  CHECK(learns([](Loop& loop) { loop.in.rest = kNaN; }) == 0);
  Prior prior(mechanism.robot);
  Loop loop(mechanism.robot, 0, &prior);
  loop.in.learn = 1;
  loop.in.rest = 0.1;
  loop.fault[loop.n] = TRUEPOSE_PLANT_JUMPED;
  loop.size[loop.n] = 0.05;
  loop.run(200);
  CHECK(loop.corrector->pupil.lines == 0 && loop.corrector->pupil.left_out == 1);
  CHECK(loop.corrector->pupil.outcome.status == TRUEPOSE_DISAGREE);
  CHECK(loop.off(loop.corrector->pupil.robot) < 1e-9);
  // A sensor that is monitored: what it may have taught lately is forgotten when it fails.
  Loop monitored(mechanism.robot, 5e-4, &prior);
  monitored.in.learn = monitored.in.learnt = monitored.in.monitor = 1;
  monitored.in.rest = 0.1;
  monitored.run(300);
  CHECK(monitored.corrector->pupil.lines == 1 && monitored.off(monitored.corrector->pupil.robot) <
                                                     monitored.off(monitored.corrector->model));
  monitored.fault[monitored.n] = TRUEPOSE_PLANT_MISSING;
  monitored.run(100);
  CHECK_NEAR(monitored.off(monitored.corrector->pupil.robot),
             monitored.off(monitored.corrector->model), 1e-12);
}

TEST("what the law cannot answer for is a fault, and motors follow their own encoders") {
  const auto faulted = [](auto spoil) {
    Loop loop(h4().robot);
    loop.in.law = TRUEPOSE_LAW_TEJ;
    loop.run(300);
    spoil(loop);
    loop.run(300);
    CHECK(loop.corrector->reason.status != TRUEPOSE_OK);
    CHECK(loop.corrector->law == TRUEPOSE_LAW_JOINT && loop.largest_correction() == 0);
    return loop.corrector->fault;
  };
  CHECK(faulted([](Loop& loop) { loop.in.largest[2] = 1e-6; }) == TRUEPOSE_TEJ_CORRECTION);
  CHECK(faulted([](Loop& loop) { loop.in.law = 17; }) == TRUEPOSE_TEJ_UNSOLVED);
  CHECK(faulted([](Loop& loop) { loop.in.law = TRUEPOSE_LAW_ESTIMATED; }) ==
        TRUEPOSE_TEJ_UNSOLVED);  // nothing is known: the table has no knowledge
  CHECK(faulted([](Loop& loop) { loop.in.q_d[0] += 3; }) == TRUEPOSE_TEJ_UNSOLVED);
  Loop unreferenced(h4().robot);
  unreferenced.in.law = TRUEPOSE_LAW_TEJ;
  unreferenced.in.referenced = 0;
  unreferenced.run(300);
  CHECK(unreferenced.corrector->law == TRUEPOSE_LAW_JOINT && unreferenced.corrector->fault == 0);
}

TEST("a motor that is not heard, or not told, asks for its amplifier to go off") {
  Loop loop(h4().robot);
  loop.run(100);
  CHECK(loop.corrector->lost == 0);
  loop.fault[loop.n] = TRUEPOSE_PLANT_MISSING;  // a sensor is none
  loop.run(10);
  CHECK(loop.corrector->lost == 0);
  loop.fault[1] = TRUEPOSE_PLANT_MISSING;
  loop.run(10);
  CHECK(loop.corrector->lost == 1U << 1 && loop.corrector->fault == TRUEPOSE_TEJ_READING);
  for (const truepose_real error : loop.corrector->error) CHECK(error == 0);
  loop.fault[1] = TRUEPOSE_PLANT_HEALTHY;
  loop.run(2);
  CHECK(loop.corrector->lost == 0);
  loop.in.q_d[2] = kNaN;
  loop.run(1);
  CHECK(loop.corrector->lost == 1U << 2 && loop.corrector->fault != 0);
}

TEST("inside the shell a machine switches on and off as without, and what stops it must be reset") {
  for_each_square([](const Mechanism& mechanism) {
    if (mechanism.robot.r == 0) return;
    const int n = mechanism.robot.motors;
    const std::uint32_t all = bit(n) - 1;
    enum { kFrozen, kTooFast, kJump, kLimits };
    for (const int fault : {kFrozen, kTooFast, kJump, kLimits}) {
      Loop loop(mechanism.robot, 0.001);
      const truepose_safety_report& safe = loop.corrector->safe;
      loop.counts(1e-5, 1e-5);
      loop.in.law = TRUEPOSE_LAW_TEJ;
      loop.in.safety = loop.in.frame_known = 1;
      std::fill_n(loop.in.speed, TRUEPOSE_MOTORS, 0.5);
      std::fill_n(loop.in.error_limit, TRUEPOSE_MOTORS, 0.1);
      const auto cycles = [&](int count, double speed = 0, bool counts = true) {
        truepose_real way[TRUEPOSE_MOTORS] = {};
        std::fill_n(way, n, speed);
        for (int k = 0; k < count; ++k) {
          loop.in.frame += counts;
          loop.run(1, way);
        }
      };
      loop.in.frame = 0xFFFFFF00U;  // it wraps
      loop.in.enable = 0;
      cycles(50);
      CHECK(safe.state == TRUEPOSE_SAFETY_STOPPED && loop.corrector->brakes == all);
      CHECK(loop.corrector->lost == 0 && !loop.corrector->inhibit);
      for (int k = 0; k < 2; ++k) {  // off and on: nobody has to acknowledge
        loop.in.enable = 1;
        cycles(5);
        CHECK(loop.corrector->brakes == all && loop.corrector->inhibit);
        cycles(60);
        CHECK(safe.state == TRUEPOSE_SAFETY_RUNNING && loop.corrector->brakes == 0);
        CHECK(!loop.corrector->inhibit && loop.corrector->lost == 0);
        cycles(300, 0.02);
        CHECK(safe.causes == 0 && loop.corrector->law == TRUEPOSE_LAW_TEJ);
        if (k == 1) break;
        loop.in.enable = 0;
        cycles(1);
        CHECK(loop.corrector->brakes == all && loop.corrector->lost == 0);
      }
      if (fault == kFrozen) cycles(3, 0.02, false);
      if (fault == kTooFast) cycles(20, 1);
      if (fault == kJump) loop.in.q_d[n - 1] += 0.15, cycles(1);
      if (fault == kLimits) {
        loop.in.enable = 0;
        loop.in.error_limit[1] = 0;
        cycles(1);
        loop.in.enable = 1;
        cycles(1);
      }
      CHECK(loop.corrector->lost == all && loop.corrector->brakes == all);
      // One of more motors than freedoms has no setpoint of its own: the command is no pose.
      const bool pose = fault != kJump || n == dof(mechanism.robot.mobility);
      CHECK(loop.corrector->fault == (pose ? TRUEPOSE_TEJ_SAFETY : TRUEPOSE_TEJ_UNSOLVED));
      const int cause = safe.cause;
      CHECK(cause == (fault == kFrozen    ? TRUEPOSE_STOP_STALE_FRAME
                      : fault == kTooFast ? TRUEPOSE_STOP_SETPOINT_SPEED
                      : fault == kJump    ? TRUEPOSE_STOP_SETPOINT_SPEED
                                          : TRUEPOSE_STOP_CONTRADICTORY_LIMITS));
      loop.in.enable = 0;
      for (int i = 0; i < n; ++i) loop.in.q_d[i] = loop.feedback(i);
      cycles(200);
      loop.in.enable = 1;
      cycles(20);
      CHECK(safe.state == TRUEPOSE_SAFETY_FAULT && safe.cause == cause);
      CHECK(loop.corrector->lost == all && loop.corrector->brakes == all);
      loop.in.enable = 0;
      loop.in.reset = 1;
      std::fill_n(loop.in.error_limit, TRUEPOSE_MOTORS, 0.1);
      cycles(1);
      loop.in.reset = 0;
      cycles(1);
      CHECK(loop.corrector->lost == 0);
      loop.in.enable = 1;
      cycles(80);
      CHECK(safe.state == TRUEPOSE_SAFETY_RUNNING && loop.corrector->brakes == 0);
      CHECK(loop.corrector->fault == TRUEPOSE_TEJ_NO_FAULT);
    }
  });
}

TEST("no NaN leaves, wherever one enters") {
  check::Random random(2);
  const double odd[] = {kNaN, HUGE_VAL, -HUGE_VAL, 1e300, -1e300};
  Prior prior(h4().robot);
  Loop loop(h4().robot, 0.003, &prior);
  loop.in.rest = 0.01;
  for (int k = 0; k < 3000; ++k) {
    const truepose_corrector_input kept = loop.in;
    truepose_real* const places[] = {loop.in.q_d, loop.in.q_e, &loop.in.band, &loop.in.blend,
                                     loop.in.largest};
    loop.in.law = k % 7 - 1;
    loop.in.monitor = k / 500 % 2;
    loop.in.learn = loop.in.learnt = k / 700 % 2;
    loop.in.reset = random() > 0.9;
    if (random() > 0) {
      const int which = static_cast<int>(2.5 * (1 + random()));
      const int entry = which < 2 ? static_cast<int>(2.5 * (1 + random())) : 0;
      places[std::min(which, 4)][entry] = odd[static_cast<int>(2.49 * (1 + random()))];
    }
    truepose_corrector_cycle(loop.corrector.get(), &loop.in);
    for (int i = 0; i < loop.n; ++i)
      CHECK(std::isfinite(loop.corrector->error[i]) &&
            std::isfinite(loop.corrector->correction[i]));
    loop.in = kept;
  }
}

TEST("a sensor that counts from power-on is known from where its index was") {
  Loop loop(h4().robot);
  truepose_index index{};
  loop.plant->absolute[loop.n] = 0;
  int asks[kMaxReadings] = {};
  const truepose_real at[kMaxReadings] = {0, 0, 0, 0, 0.05}, none[kMaxReadings] = {};
  const truepose_real speed[TRUEPOSE_MOTORS] = {0.1, 0.1, -0.05, 0.05};
  CHECK(truepose_index_cycle(&index, 0, &asks[loop.n]) == 0 && asks[loop.n] == 0);
  int known = 0;
  for (int k = 0; k < 400 && !known; ++k) {
    known = truepose_index_cycle(&index, 1, &asks[loop.n]);
    truepose_plant_cycle(loop.plant.get(), speed, loop.fault, none, at, asks);
  }
  CHECK(known);
  CHECK_NEAR(loop.plant->read[loop.n] + at[loop.n], loop.plant->x[3], 1e-12);
}

TEST("encoders count, freeze and jump as they are told") {
  Loop loop(h4().robot);
  loop.plant->robot.sensor[0].step = 1e-3;
  loop.plant->coarse = 1;
  const truepose_real speed[TRUEPOSE_MOTORS] = {0.1, 0.1, -0.05, 0.05};
  loop.run(50, speed);
  const double read = loop.plant->read[loop.n];
  CHECK(std::fabs(read - loop.plant->x[3]) <= 0.5001e-3);
  CHECK_NEAR(read, 1e-3 * std::nearbyint(read / 1e-3), 1e-12);
  loop.fault[loop.n] = TRUEPOSE_PLANT_FROZEN;
  loop.run(100, speed);
  CHECK(loop.plant->read[loop.n] == read);
  CHECK(std::fabs(loop.plant->x[3] - read) > 1e-3);
  const truepose_real wild[TRUEPOSE_MOTORS] = {1e4, 1e4, 1e4, 1e4}, none[kMaxReadings] = {};
  int asks[kMaxReadings] = {};
  const double x = loop.plant->x[0];
  truepose_plant_cycle(loop.plant.get(), wild, loop.fault, none, none, asks);
  CHECK(loop.plant->blocked == 1 && loop.plant->x[0] == x);
}
