// The robot as plain data, and robots that are not finished. By the one include.
#include "truepose/core.hpp"

#include <climits>
#include <cstring>
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
    chain.pair_drawn = Vec3::UnitZ().cross(chain.zero());
    chain.axis = exp_so3(2e-3 * (i - 1) * chain.zero()) * chain.pair_drawn();
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
  robot.body[0].inertia = Vec3(0, 0, 0.003).asDiagonal();
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
    learner.pose = to_pose<kH4>(robot.home);
  }
};

/// One answer: how it went, and its numbers.
using Answer = std::pair<Status, std::vector<double>>;

template <class Values>
Answer answer(Outcome outcome, const Values& values) {
  return {outcome.status, {values.begin(), values.end()}};
}
template <class Rows>
Answer of_rows(Outcome outcome, const Rows& rows) {
  Answer all{outcome.status, {}};
  for (const auto& row : rows) all.second.insert(all.second.end(), row.begin(), row.end());
  return all;
}
Outcome outcome_of(const FkmResult& result) { return {result.status, result.chain}; }

/// Asks a robot everything that it can be asked. What it is called with is sound for any robot.
std::vector<std::pair<const char*, Answer>> ask(const Robot& robot) {
  const Coordinates x{0.02, -0.03, -0.52, 0.1};
  const Pose pose = to_pose<kH4>(x);
  std::vector<std::pair<const char*, Answer>> all;
  const auto add = [&](const char* name, const Answer& one) { all.emplace_back(name, one); };
  Joint q{}, torque{};
  Coordinates found = x, acceleration{};
  Reading r{};
  JointMatrix J{};
  Extended q_e{};
  Matrix<kMaxReadings, 4> H_x{};
  ExtendedColumns M{};
  ExtendedRows M_plus{};
  Memory memory;
  memory.believe(robot);

  add("ikm", answer(ikm(robot, x, q), q));
  add("ikm_full", answer(ikm_full(robot, x, q), q));
  add("command", answer(command(robot, x, q), q));
  add("command_full", answer(command_full(robot, x, q), q));
  add("within_limits", answer(within_limits(robot, q), q));
  add("fkm", answer(outcome_of(fkm(robot, q, found)), found));
  add("fkm_full", answer(outcome_of(fkm_full(robot, q, found)), found));
  Vec3 D = Vec3::Zero();
  add("fkm_closed", answer(fkm_closed<kH4>(robot, q, pose.R, Vec3(0, 0, -0.4), D), D));
  add("rkm", answer(rkm(robot, x, r), r));
  add("rkm_full", answer(rkm_full(robot, x, r), r));
  add("jacobian", of_rows(jacobian(robot, x, J), J));
  add("jacobian_full", of_rows(jacobian_full(robot, x, J), J));
  add("parasitic", answer(parasitic(robot, x, torque), torque));
  double parallel = 0;
  add("conditioning", answer(conditioning(robot, x, parallel, torque), torque));
  add("tej", of_rows(tej(robot, x, M, M_plus), M_plus));
  add("extended", answer(extended<kH4>(robot, pose, q_e), q_e));
  add("redundant_fkm", answer(redundant_fkm(robot, q_e, found), found));
  add("read_standing",
      answer(read_standing<kH4>(robot, to_full(pose), Joint{}, Joint{}, q_e), q_e));
  add("linearise", of_rows(linearise<kH4>(robot, pose, q_e, H_x, nullptr), H_x));
  add("linearise_full", of_rows(linearise_full<kH4>(robot, pose, q_e, H_x, nullptr), H_x));
  Pose near = pose;
  const Outcome estimated =
      estimate<kH4>(robot, memory.known, q_e, near, memory.work.data()).outcome;
  add("estimate", answer(estimated, to_coordinates<kH4>(near)));
  add("forward_dynamics",
      answer(forward_dynamics<kH4>(robot, pose, Joint{}, Joint{}, acceleration), acceleration));
  ControlSettings settings;
  add("place_poles", answer(place_poles(robot, x, 100, 1, settings), settings.kp));
  for (const Law law : {Law::joint, Law::tej, Law::cartesian, Law::weighted, Law::estimated}) {
    ControlState state;
    settings.law = law;
    const Weighing weighing{&memory.known, memory.work.data()};
    const Outcome outcome = control(robot, settings, {x, {}, {}}, q_e, state, weighing);
    add("control", answer(outcome, state.torque));
  }
  add("drawn_parameters", answer(drawn_parameters(robot, memory.xi.data()), memory.xi));
  Robot other = robot;
  add("set_parameters", answer(set_parameters(robot, memory.xi.data(), other), r));
  add("learn", answer(calibrate_online<kH4>(memory.learner, q_e), memory.root));
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

TEST("robots are copied byte by byte, and the copy answers bit for bit") {
  static_assert(kPlain<Robot> && kPlain<Chain> && kPlain<Sensor> && kPlain<Body>);
  Robot robot = drawn();
  CHECK(finish(robot) && finish_full(robot));
  CHECK(robot.full.kind == FullKind::exists);
  for (const Level level : {Level::ideal, Level::full}) {
    robot.level = level;
    Robot copy;
    std::memcpy(static_cast<void*>(&copy), &robot, sizeof robot);
    const auto expected = ask(robot), answers = ask(copy);
    for (std::size_t k = 0; k < answers.size(); ++k) {
      check::state().scene = expected[k].first;
      CHECK(expected[k].second.first <= Status::ok);
      CHECK(answers[k].second == expected[k].second);
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
    for (const auto& [name, one] : ask(*robot)) {
      check::state().scene = name;
      CHECK(one.first == Status::unfinished);
    }
  CHECK(finish_full(never).status == Status::unfinished);
}

TEST("every wrong count, index and enum is refused, and what was refused stays unfinished") {
  const Status part = Status::no_such_part, square = Status::not_square;
  const Wrong wrongs[]{
      {"mobility 8", part, [](Robot& r) { r.mobility = wild<Mobility>(kMobilities); }},
      {"a pivot of four chains", square, [](Robot& r) { r.mobility = Mobility::rotational_2; }},
      {"mobility -1", part, [](Robot& r) { r.mobility = wild<Mobility>(-1); }},
      {"chains -1", part, [](Robot& r) { r.chains = -1; }},
      {"chains 7", part, [](Robot& r) { r.chains = kMaxChains + 1; }},
      {"chains 3", part, [](Robot& r) { r.chains = 3; }},  // and four motors
      {"chains 5", square, [](Robot& r) { r.chains = 5; }},
      {"motors 3", square, [](Robot& r) { r.motors = 3; }},
      {"motors 5", part, [](Robot& r) { r.motors = 5; }},
      {"motors -1", part, [](Robot& r) { r.motors = -1; }},
      {"belts", square, [](Robot& r) { r.mobility = Mobility::planar_translation; }},
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
    CHECK(ikm(robot, {0, 0, -0.5}, q).status == Status::unfinished);
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
