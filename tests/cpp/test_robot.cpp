// The robot as plain data, and robots that are not finished. By the one include.
#include "control/command.hpp"
#include "control/fault_tolerant_control.hpp"
#include "control/guarded_control.hpp"
#include "control/joints.hpp"
#include "estimation/estimate.hpp"
#include "estimation/linearise.hpp"
#include "estimation/online_calibrator.hpp"
#include "mechanism/fkm.hpp"
#include "mechanism/geometry.hpp"

#include <climits>
#include <functional>
#include <numbers>

#include "check.hpp"

using namespace truepose;

namespace {

constexpr Mobility kH4 = Mobility::schoenflies;
constexpr int kUncertain = 4;

/// The H4 of robots/h4, its axes a little off and an encoder on its nacelle; not finished.
Robot drawn() {
  Robot robot;
  robot.mobility = kH4;
  robot.chains = robot.motors = 4;
  constexpr double angle[]{0, std::numbers::pi, 1.5 * std::numbers::pi, 1.5 * std::numbers::pi};
  const Vec3 base[]{{0.2, 0.06, 0}, {-0.2, 0.06, 0}, {-0.06, -0.2, 0}, {0.06, -0.2, 0}};
  for (int i = 0; i < 4; ++i) {
    Chain& chain = robot.chain[i];
    chain.base = base[i];
    chain.zero = Vec3(std::cos(angle[i]), std::sin(angle[i]), 0);
    chain.pair_drawn = Vec3::UnitZ().cross(chain.zero);
    chain.axis = exp_so3(2e-3 * (i - 1) * chain.zero) * chain.pair_drawn;
    chain.pair_axis = chain.axis;
    chain.arm = 0.26;
    chain.rod = 0.48;
    chain.pivot = Vec3(i == 0 || i == 3 ? 0.06 : -0.06, 0, 0);
    chain.anchor = Vec3(0, i < 2 ? 0.06 : -0.06, 0);
    chain.bar = i == 0 || i == 3 ? 0 : 1;
    chain.rod_spacing = 0.08;
    chain.drive_inertia = 0.017;
    chain.low = -0.6;
    chain.high = 1.6;
  }
  robot.sensor[0].noise = 1e-4;
  robot.r = robot.bodies = 1;
  robot.body[0].mass = 1;
  robot.body[0].inertia(2, 2) = 0.003;
  robot.home = {0, 0, -0.5, 0};
  return robot;
}

/// What estimating and learning need besides a robot; as much of it as a finished one asks for.
struct Memory {
  std::array<int, kUncertain> column{chain_column(0) + 3, chain_column(1) + 4, chain_column(2) + 5,
                                     chain_column(3) + 17};
  std::vector<double> root = std::vector<double>(kUncertain * kUncertain), xi, work;
  Knowledge known{kUncertain, column.data(), root.data(), {}};
  OnlineCalibrator learner;

  Memory() : xi(400), work(20000) {
    for (int k = 0; k < kUncertain; ++k) root[k * kUncertain + k] = 1e-3;
    known.sigma.fill(1e-4);
  }
  void believe(const Robot& robot) {
    learner.drawn = &robot;
    learner.robot = robot;
    learner.state = {kUncertain, column.data(), xi.data(), root.data(), known.sigma};
    learner.work = work.data();
    learner.pose = to_pose(kH4, robot.home);
  }
};

template <class Result>
Outcome outcome_of(const Result& result) {
  return {result.status, result.chain};
}

/// Asks a robot everything that it can be asked. What it is called with is sound for any robot.
std::vector<std::pair<const char*, Outcome>> ask(const Robot& robot) {
  const Coordinates x{0.02, -0.03, -0.52, 0.1};
  const Pose pose = to_pose(kH4, x);
  Joint q{}, torque{};
  Coordinates found = x, acceleration{}, turns{};
  JointMatrix J{};
  Extended q_e{};
  PoseRows H_x{};
  ExtendedColumns M{};
  ExtendedRows M_plus{};
  Memory memory;
  memory.believe(robot);
  Vec3 D = Vec3::Zero();
  double parallel = 0;
  Pose near = pose;
  Robot other = robot;
  ControlSettings settings;
  std::vector<std::pair<const char*, Outcome>> all{
      {"ikm", ikm(Level::ideal, robot, x, q)},
      {"ikm_full", ikm(Level::full, robot, x, q)},
      {"command", command(Level::ideal, robot, x, q)},
      {"command_full", command(Level::full, robot, x, q)},
      {"within_limits", within_limits(robot, q)},
      {"fkm", outcome_of(fkm(Level::ideal, robot, q, found))},
      {"fkm_full", outcome_of(fkm(Level::full, robot, q, found))},
      {"fkm_closed", fkm_closed(robot, q, pose.R, Vec3(0, 0, -0.4), D)},
      {"jacobian", jacobian(Level::ideal, robot, x, J)},
      {"jacobian_full", jacobian(Level::full, robot, x, J)},
      {"parasitic", parasitic(robot, x, turns)},
      {"conditioning", conditioning(robot, x, parallel, torque)},
      {"tej", tej(robot, x, M, M_plus)},
      {"extended", extended(Level::ideal, robot, pose, q_e)},
      {"extended_full", extended(Level::full, robot, pose, q_e)},
      {"redundant_fkm", redundant_fkm(robot, q_e, found)},
      {"read_standing", read_standing(robot, to_full(pose), Joint{}, Joint{}, q_e)},
      {"linearise", linearise(Level::ideal, robot, pose, q_e, H_x, nullptr)},
      {"linearise_full", linearise(Level::full, robot, pose, q_e, H_x, nullptr)},
      {"estimate",
       estimate(Level::ideal, robot, memory.known, q_e, near, memory.work.data()).outcome},
      {"forward_dynamics", forward_dynamics(robot, pose, {}, {}, acceleration)},
      {"place_poles", place_poles(robot, x, 100, 1, settings)},
      {"drawn_parameters", drawn_parameters(robot, memory.xi.data())},
      {"set_parameters", set_parameters(robot, memory.xi.data(), other)},
      {"learn", calibrate_online(memory.learner, q_e)}};
  for (const Law law : {Law::joint, Law::tej, Law::cartesian, Law::weighted, Law::estimated}) {
    ControlState state;
    settings.law = law;
    const Weighing weighing{&memory.known, memory.work.data()};
    all.emplace_back("control", control(robot, settings, {x, {}, {}}, q_e, state, weighing));
  }
  return all;
}

template <class T>
constexpr bool kPlain = std::is_trivially_copyable_v<T> && std::is_standard_layout_v<T>;

/// A robot that no check may let pass, and why.
struct Wrong {
  const char* what;
  Status status;
  std::function<void(Robot&)> make;
};
template <class Enum>
Enum wild(int value) {
  return static_cast<Enum>(value);
}

}  // namespace

TEST("robots are plain data, which a finished one answers by at both levels") {
  static_assert(kPlain<Robot> && kPlain<Chain> && kPlain<Sensor> && kPlain<Body>);
  Robot robot = drawn();
  CHECK(finish(robot) && finish_full(robot));
  CHECK(robot.full.kind == FullKind::exists);
  for (const Level level : {Level::ideal, Level::full}) {
    robot.level = level;
    for (const auto& [name, outcome] : ask(robot)) {
      check::state().scene = name;
      CHECK(outcome.status <= Status::ok);
    }
  }
}

TEST("a robot that is not finished answers nothing, whatever its memory holds") {
  Robot never = drawn(), empty, stale = drawn();
  CHECK(finish(stale) && finish_full(stale));
  stale.finished = false;
  Robot garbage = stale;
  garbage.mobility = wild<Mobility>(-77);
  garbage.chains = garbage.motors = garbage.r = garbage.bodies = INT_MAX;
  garbage.chain[1].bar = garbage.sensor[0].chain = INT_MIN;
  for (const Robot* robot : {&never, &empty, &stale, &garbage})
    for (const auto& [name, outcome] : ask(*robot)) {
      check::state().scene = name;
      CHECK(outcome.status == Status::unfinished);
    }
  CHECK(finish_full(never).status == Status::unfinished);
}

TEST("every wrong count, index and enum is refused, and what was refused stays unfinished") {
  const Status part = Status::no_such_part, square = Status::not_square;
  const Wrong wrongs[]{
      {"mobility 8", part, [](Robot& r) { r.mobility = wild<Mobility>(kMobilities); }},
      {"six freedoms, four chains", square, [](Robot& r) { r.mobility = Mobility::spatial; }},
      {"mobility -1", part, [](Robot& r) { r.mobility = wild<Mobility>(-1); }},
      {"chains -1", part, [](Robot& r) { r.chains = -1; }},
      {"chains 7", part, [](Robot& r) { r.chains = kMaxChains + 1; }},
      {"chains 3", part, [](Robot& r) { r.chains = 3; }},  // and four motors
      {"chains 5", square, [](Robot& r) { r.chains = 5; }},
      {"motors 3", square, [](Robot& r) { r.motors = 3; }},
      {"motors 5", part, [](Robot& r) { r.motors = 5; }},
      {"motors -1", part, [](Robot& r) { r.motors = -1; }},
      {"sensors -1", part, [](Robot& r) { r.r = -1; }},
      {"sensors 13", part, [](Robot& r) { r.r = kMaxSensors + 1; }},
      {"sensors", part, [](Robot& r) { r.r = INT_MAX; }},
      {"bodies 9", part, [](Robot& r) { r.bodies = kMaxBodies + 1; }},
      {"bodies -1", part, [](Robot& r) { r.bodies = -1; }},
      {"actuator", part, [](Robot& r) { r.chain[3].actuator = wild<Actuator>(3); }},
      {"working mode 0", part, [](Robot& r) { r.chain[0].working_mode = 0; }},
      {"bar of a chain", part, [](Robot& r) { r.chain[2].bar = kMaxBars; }},
      {"bar of a body", part, [](Robot& r) { r.body[0].bar = -2; }},
      {"kind", part, [](Robot& r) { r.sensor[0].kind = wild<SensorKind>(kSensorKinds); }},
      {"kind -1", part, [](Robot& r) { r.sensor[0].kind = wild<SensorKind>(-1); }},
      {"chain of a sensor", part, [](Robot& r) { r.sensor[0].chain = 1; }},  // it sees none
      {"sensor's chain 4", part,
       [](Robot& r) {
         r.sensor[0].kind = SensorKind::motor_encoder;
         r.sensor[0].chain = 4;
       }},
      {"a rod's sensor on no chain", part,
       [](Robot& r) { r.sensor[0].kind = SensorKind::rod_length; }},
      {"rod of a sensor", part, [](Robot& r) { r.sensor[0].rod = 0; }},
      {"bar of a sensor", part, [](Robot& r) { r.sensor[0].bar = 2; }},
      {"bars' joint", part, [](Robot& r) { r.bar_joint = wild<BarJoint>(2); }},
      {"level", part, [](Robot& r) { r.level = wild<Level>(2); }}};
  for (const Wrong& wrong : wrongs) {
    check::state().scene = wrong.what;
    Robot robot = drawn();
    CHECK(finish(robot));
    wrong.make(robot);
    CHECK(finish(robot).status == wrong.status);
    CHECK(!robot.finished);
    Joint q{};
    CHECK(ikm(Level::ideal, robot, {0, 0, -0.5}, q).status == Status::unfinished);
    CHECK(finish_full(robot).status == Status::unfinished);
  }
}

TEST("a refusal names the chain or the sensor that is wrong") {
  for (int part = 0; part < 3; ++part) {
    Robot robot = drawn();
    robot.r = 3;
    robot.chain[part].working_mode = 0;
    CHECK(finish(robot).chain == part);
    robot.chain[part].working_mode = 1;
    robot.sensor[part].kind = wild<SensorKind>(kSensorKinds);
    CHECK(finish(robot).chain == kSensorPart + part);
    robot.sensor[part].kind = SensorKind{};
    robot.sensor[part].rod = 0;
    CHECK(finish(robot).chain == kSensorPart + part);
  }
}
