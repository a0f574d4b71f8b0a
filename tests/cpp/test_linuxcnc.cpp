// Do LinuxCNC's components do what they say, whatever they are told? Without LinuxCNC: their cores.
#include <limits>
#include <memory>

#include "../../src/c/description.hpp"
#include "mechanisms.hpp"

extern "C" {
#include "../../deploy/linuxcnc/geometry.h"
#include "../../deploy/linuxcnc/plant_core.h"
#include "../../deploy/linuxcnc/tej_core.h"
}

using namespace mechanisms;

namespace {

constexpr double kPeriod = 1e-3, kGain = 50, kNaN = std::numeric_limits<double>::quiet_NaN();

truepose_description table_of(const Robot& robot) {
  truepose_description table;
  c::describe(robot, table);
  return table;
}

/// A machine, its last motor's rod 3 mm longer than its controller knows, and drives that follow.
struct Loop {
  explicit Loop(const Robot& robot, double longer = 0.003) : n(robot.motors) {
    corrector->table.robot = corrector->table.finest = table_of(robot);
    CHECK(truepose_corrector_begin(corrector.get(), kPeriod).status == TRUEPOSE_OK);
    truepose_description machine = table_of(robot);
    machine.chain[n - 1].rod += longer;
    truepose_real q[6];
    CHECK(truepose_ikm(&corrector->model, machine.home, q).status == TRUEPOSE_OK);
    CHECK(truepose_plant_begin(plant.get(), &machine, kPeriod, q).status == TRUEPOSE_OK);
    plant->coarse = 0;
    for (int c = 0; c < kMaxReadings; ++c) plant->absolute[c] = 1;
    std::copy_n(q, 6, in.q_d);
    in.enable = in.referenced = 1;
    in.blend = 0.2;
    in.largest = 0.2;
  }

  /// @return the largest change of the correction in a cycle, rad or m
  double run(int cycles, const truepose_real* speed = nullptr) {
    double step = 0;
    for (int k = 0; k < cycles; ++k) {
      truepose_real velocity[6] = {}, before[6];
      int asks[kMaxReadings] = {};
      const truepose_real none[kMaxReadings] = {};
      for (int i = 0; i < n && speed != nullptr; ++i) in.q_d[i] += kPeriod * speed[i];
      std::copy_n(corrector->correction, 6, before);
      std::copy_n(plant->read, kMaxReadings, in.q_e);
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
  double largest_correction() const {
    double largest = 0;
    for (int i = 0; i < n; ++i) largest = std::max(largest, std::fabs(corrector->correction[i]));
    return largest;
  }

  int n;
  std::unique_ptr<truepose_corrector> corrector = std::make_unique<truepose_corrector>();
  std::unique_ptr<truepose_plant> plant = std::make_unique<truepose_plant>();
  truepose_corrector_input in{};
  int32_t fault[kMaxReadings] = {};
  truepose_real size[kMaxReadings] = {};
};

/// What a ramp of 0.2 s over a correction moves in a cycle: its quintic's steepest part.
double ramp(double correction) { return 1.875 * correction * kPeriod / 0.2; }

}  // namespace

TEST("joints of a pose lead back to it, in machine units, and other axes pass") {
  check::Random random(1);
  for_each([&](const Mechanism& mechanism, auto) {
    const auto kins = std::make_unique<truepose_kins>();
    const truepose_description table = table_of(mechanism.robot);
    CHECK(truepose_kins_load(kins.get(), &table, 0.001).status == TRUEPOSE_OK);
    CHECK(truepose_kins_extras(kins.get(), "w"));
    CHECK(!truepose_kins_extras(kins.get(), "x"));
    CHECK(!truepose_kins_extras(kins.get(), "ww"));
    CHECK(truepose_kins_extras(kins.get(), "w"));
    for (int k = 0; k < 20; ++k) {
      const Coordinates x = random_pose(mechanism, random, 0.5);
      truepose_real q[6], axes[9] = {}, joints[9] = {}, found[9] = {};
      CHECK(truepose_ikm(&kins->model, x.data(), q).status == TRUEPOSE_OK);
      for (int i = 0; i < kins->motors; ++i) joints[i] = q[i] / kins->scale[i];
      joints[kins->motors] = 7;
      CHECK(truepose_kins_forward(kins.get(), joints, axes) <= TRUEPOSE_OK);
      CHECK(axes[8] == 7);
      CHECK(truepose_kins_inverse(kins.get(), axes, found) <= TRUEPOSE_OK);
      for (int i = 0; i <= kins->motors; ++i) CHECK_NEAR(found[i], joints[i], 1e-8);
      axes[0] = kNaN;
      CHECK(truepose_kins_inverse(kins.get(), axes, found) == TRUEPOSE_NOT_FINITE);
      for (int i = 0; i <= kins->motors; ++i) CHECK_NEAR(found[i], joints[i], 1e-8);
    }
    CHECK(kins->conditioning > 0);
    kins->least_conditioning = 1;
    truepose_real axes[9] = {}, joints[9];
    axes[0] = 1000 * table.home[0], axes[1] = 1000 * table.home[1], axes[2] = 1000 * table.home[2];
    CHECK(truepose_kins_inverse(kins.get(), axes, joints) > TRUEPOSE_OK);
  });
}

TEST("under a law of redundant sensors the pose that they see is right, and no motor jumps") {
  const Mechanism mechanism = h4();
  for (const int law : {TRUEPOSE_LAW_REDUNDANT, TRUEPOSE_LAW_CARTESIAN}) {
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
    truepose_real e[6];  // at rest: what the law itself says of these readings
    CHECK(truepose_motor_error(&loop.corrector->model, law, 0, loop.corrector->x_d,
                               loop.plant->read, nullptr, nullptr, e)
              .status == TRUEPOSE_OK);
    for (const truepose_real error : e) CHECK_NEAR(error, 0, 1e-9);
  }
}

TEST("off and on again, and from law to law, motors follow without a step") {
  Loop loop(h4().robot);
  loop.in.law = TRUEPOSE_LAW_REDUNDANT;
  loop.run(1000);
  const double most = 1.2 * ramp(loop.largest_correction());
  loop.in.enable = 0;
  loop.run(50);
  CHECK(loop.largest_correction() == 0);
  loop.in.enable = 1;
  CHECK(loop.run(1000) < most);
  loop.in.law = TRUEPOSE_LAW_CARTESIAN;
  CHECK(loop.run(100) < most);
  loop.in.law = TRUEPOSE_LAW_JOINT;  // while the change before is under way
  CHECK(loop.run(100) < most);
  loop.in.law = TRUEPOSE_LAW_REDUNDANT;
  CHECK(loop.run(1000) < most);
}

TEST("a sensor that stops is said, and what it corrected is held and ramped out") {
  Loop loop(h4().robot);
  loop.in.law = TRUEPOSE_LAW_REDUNDANT;
  loop.run(1000);
  const double correction = loop.largest_correction();
  const truepose_real speed[6] = {0.1, 0.1, 0.1, 0.1};
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
  CHECK(loop.corrector->fault == 0 && loop.corrector->law == TRUEPOSE_LAW_REDUNDANT);
}

TEST("a sensor that is watched ends the law before its lie reaches a drive") {
  for (const int lie : {TRUEPOSE_PLANT_MISSING, TRUEPOSE_PLANT_JUMPED}) {
    double worst[2];
    for (const int watch : {0, 1}) {
      Loop loop(h4().robot, 0.0);
      Prior prior(h4().robot);
      truepose_table& table = loop.corrector->table;
      table.watched = 1;
      table.known.count = prior.known().count;
      table.known.column = table.column;
      table.known.root = table.root;
      std::copy_n(prior.known().column, table.known.count, table.column);
      std::copy_n(prior.known().root, table.known.count * table.known.count, table.root);
      std::copy_n(prior.known().sigma.begin(), kMaxReadings, table.known.sigma);
      c::describe(GuardSettings{}, table.watch);
      loop.in.law = TRUEPOSE_LAW_REDUNDANT;
      loop.in.watch = watch;
      loop.run(300);
      CHECK(loop.corrector->fault == 0 && loop.corrector->law == TRUEPOSE_LAW_REDUNDANT);
      loop.fault[loop.n] = lie;
      loop.size[loop.n] = 0.05;
      worst[watch] = 0;
      for (int k = 0; k < 300; ++k) {
        loop.run(1);
        worst[watch] = std::max(worst[watch], loop.largest_correction());
      }
      if (watch) CHECK(loop.corrector->fault == TRUEPOSE_TEJ_WATCH && loop.corrector->law == 0);
    }
    CHECK(worst[1] < 1e-3);
    CHECK(lie == TRUEPOSE_PLANT_MISSING || worst[0] > 3e-3);
  }
}

TEST("what the law cannot answer for is a fault, and motors follow their own encoders") {
  const auto faulted = [](auto spoil) {
    Loop loop(h4().robot);
    loop.in.law = TRUEPOSE_LAW_REDUNDANT;
    loop.run(300);
    spoil(loop);
    loop.run(300);
    CHECK(loop.corrector->law == TRUEPOSE_LAW_JOINT && loop.largest_correction() == 0);
    return loop.corrector->fault;
  };
  CHECK(faulted([](Loop& loop) { loop.in.largest = 1e-6; }) == TRUEPOSE_TEJ_CORRECTION);
  CHECK(faulted([](Loop& loop) { loop.in.law = 17; }) == TRUEPOSE_TEJ_UNSOLVED);
  CHECK(faulted([](Loop& loop) { loop.in.law = TRUEPOSE_LAW_ESTIMATED; }) ==
        TRUEPOSE_TEJ_UNSOLVED);  // nothing is known: the table has no knowledge
  CHECK(faulted([](Loop& loop) { loop.in.q_d[0] += 3; }) == TRUEPOSE_TEJ_UNSOLVED);
  Loop unreferenced(h4().robot);
  unreferenced.in.law = TRUEPOSE_LAW_REDUNDANT;
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
  CHECK(loop.corrector->lost == 1 && loop.corrector->fault == TRUEPOSE_TEJ_READING);
  for (const truepose_real error : loop.corrector->error) CHECK(error == 0);
  loop.fault[1] = TRUEPOSE_PLANT_HEALTHY;
  loop.run(2);
  CHECK(loop.corrector->lost == 0);
  loop.in.q_d[2] = kNaN;
  loop.run(1);
  CHECK(loop.corrector->lost == 1 && loop.corrector->fault != 0);
}

TEST("no NaN leaves, wherever one enters") {
  check::Random random(2);
  const double odd[] = {kNaN, HUGE_VAL, -HUGE_VAL, 1e300, -1e300};
  Loop loop(h4().robot);
  for (int k = 0; k < 3000; ++k) {
    const truepose_corrector_input kept = loop.in;
    truepose_real* const places[] = {loop.in.q_d, loop.in.q_e, &loop.in.band, &loop.in.blend,
                                     &loop.in.largest};
    loop.in.law = k % 7 - 1;
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
  const truepose_real speed[6] = {0.1, 0.1, -0.05, 0.05};
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
  const truepose_real speed[6] = {0.1, 0.1, -0.05, 0.05};
  loop.run(50, speed);
  const double read = loop.plant->read[loop.n];
  CHECK(std::fabs(read - loop.plant->x[3]) <= 0.5001e-3);
  CHECK_NEAR(read, 1e-3 * std::nearbyint(read / 1e-3), 1e-12);
  loop.fault[loop.n] = TRUEPOSE_PLANT_FROZEN;
  loop.run(100, speed);
  CHECK(loop.plant->read[loop.n] == read);
  CHECK(std::fabs(loop.plant->x[3] - read) > 1e-3);
  const truepose_real wild[6] = {1e4, 1e4, 1e4, 1e4}, none[kMaxReadings] = {};
  int asks[kMaxReadings] = {};
  const double x = loop.plant->x[0];
  truepose_plant_cycle(loop.plant.get(), wild, loop.fault, none, none, asks);
  CHECK(loop.plant->blocked == 1 && loop.plant->x[0] == x);
}
