// Mechanisms of the tests that are described by bodies and closures, and robots of them.
#include "described.hpp"

namespace mechanisms_described {

using engine::Kind;
using engine::Position;

namespace {

/// Three legs with hinges at the base and balls on the platform, which keep each in a plane.
/// x: height, pitch, roll; hidden: the parasitic motions along x, y and about z.
engine::Mechanism three_rps() {
  engine::Mechanism m;
  m.motors = m.coordinates = 3, m.freedoms = 9, m.bodies = 6, m.closures = 6;
  m.body[0] = {.kind = Kind::slide, .parent = -1, .freedom = 3, .axis = Vec3::UnitZ()};
  m.body[1] = {.kind = Kind::slide, .parent = 0, .freedom = 6, .axis = Vec3::UnitX()};
  m.body[2] = {.kind = Kind::slide, .parent = 1, .freedom = 7, .axis = Vec3::UnitY()};
  m.body[3] = {.kind = Kind::hinge, .parent = 2, .freedom = 4, .axis = Vec3::UnitY()};
  m.body[4] = {.kind = Kind::hinge, .parent = 3, .freedom = 5, .axis = Vec3::UnitX()};
  m.body[5] = {.kind = Kind::hinge, .parent = 4, .freedom = 8, .axis = Vec3::UnitZ()};
  for (int i = 0; i < 3; ++i) {
    const Vec3 A = polar(0.2, 120 * i), B = polar(0.31, 120 * i + 1),
               hinge = polar(1, 120 * i + 91);
    m.closure[2 * i] = {.body_a = 5, .a = A, .b = B, .driven = i};
    m.closure[2 * i + 1] = {.body_a = 5, .a = A, .b = B, .plane = true, .normal = hinge};
  }
  return m;
}

/// The same platform on three carriages: rods of fixed length in the planes of their hinges.
engine::Mechanism three_prs() {
  engine::Mechanism m = three_rps();
  for (int i = 0; i < 3; ++i) {
    const Vec3 B = m.closure[2 * i].b;
    m.body[m.bodies] = {.kind = Kind::slide, .freedom = i, .origin = B, .axis = Vec3::UnitZ()};
    for (int k = 2 * i; k < 2 * i + 2; ++k)
      m.closure[k].body_b = m.bodies, m.closure[k].b = Vec3::Zero(), m.closure[k].driven = -1;
    m.closure[2 * i].length = 0.5, m.closure[2 * i].motor = i, m.closure[2 * i].mode = -1;
    ++m.bodies;
  }
  return m;
}

/// Four arms and rods on a planar platform: one motor more than freedoms.
engine::Mechanism four_rrr() {
  engine::Mechanism m;
  m.motors = 4, m.coordinates = 3, m.freedoms = 7, m.bodies = 6, m.closures = 4;
  m.body[4] = {.kind = Kind::shift, .freedom = 4, .count = 2};
  m.body[5] = {.kind = Kind::hinge, .parent = 4, .freedom = 6};
  for (int i = 0; i < 4; ++i) {
    m.body[i] = {.freedom = i, .origin = polar(0.4, 90 * i + 2 * i)};
    m.closure[i] = {.body_a = 5,
                    .body_b = i,
                    .a = polar(0.1, 90 * i),
                    .b = polar(0.2, 90 * i + 120),
                    .length = 0.28 + 0.004 * i,
                    .motor = i};
  }
  return m;
}

/// Two platforms on balls, the second on the first, each held by three legs from the base.
engine::Mechanism two_balls() {
  engine::Mechanism m;
  m.motors = m.coordinates = 6, m.freedoms = 12, m.bodies = 2, m.closures = 6;
  m.body[0] = {.kind = Kind::ball, .freedom = 6, .count = 3, .origin = {0, 0, 0.3}};
  m.body[1] = {.kind = Kind::ball, .parent = 0, .freedom = 9, .count = 3, .origin = {0, 0, 0.2}};
  for (int i = 0; i < 6; ++i)
    m.closure[i] = {.body_a = i / 3,
                    .a = polar(0.1, 120 * i, 0.02),
                    .b = polar(0.3, 120 * i + 30),
                    .driven = i};
  return m;
}

/// Finds the motors at home.
Described at_home(const char* name, const engine::Mechanism& m, std::initializer_list<double> home,
                  double box, double motor) {
  Described made{name, m, {}, {}};
  std::fill_n(made.home.begin(), m.motors, motor);
  std::copy(home.begin(), home.end(), made.home.begin() + m.motors);
  std::fill_n(made.box.begin() + m.motors, m.coordinates, box);
  Position at;
  at.y = made.home;
  CHECK(engine::close(m, at, engine::inverse(m)));
  made.home = at.y;
  return made;
}

}  // namespace

std::vector<Described> described() {
  return {at_home("3-RPS", three_rps(), {0.5, 0.02, 0.03}, 0.1, 0.5),
          at_home("3-PRS", three_prs(), {0.5, 0.02, 0.03}, 0.1, 0.05),
          at_home("4-RRR", four_rrr(), {0.01, 0.02, 0.03}, 0.05, 0.1),
          at_home("two balls", two_balls(), {0.05, 0.02, 0.01, 0.03, 0.02, -0.1}, 0.2, 0.35)};
}

namespace {
/// The 3-RPS upside down: its legs turn about hinges of the platform, on balls at the base.
engine::Mechanism three_spr() {
  engine::Mechanism m = three_rps();
  for (int i = 0; i < 3; ++i) {
    engine::Closure& plane = m.closure[2 * i + 1];
    std::swap(plane.body_a, plane.body_b), std::swap(plane.a, plane.b);
    plane.exchanged = true;
  }
  return m;
}

Sensor sensor(SensorKind kind, int index) {
  Sensor made;
  made.kind = kind;
  (properties(kind).of_chain ? made.chain : made.axis) = index;
  made.gain = 1.2, made.offset = 0.1;
  made.origin = Vec3(-0.9, 0.2, 0.1), made.target = Vec3(0.04, -0.03, 0.02);
  made.direction = Vec3(0.9, 0.3, -0.2).normalized();
  made.normal = Vec3(0.3, -0.5, 0.6).normalized();
  if (rotary(made)) made.eccentricity = {3, {0.02, -0.01, 0.006, 0.01}};
  return made;
}

/// A robot of a mechanism: its encoders err, each in its way.
Mechanism robot_of(const Described& of) {
  Mechanism made{of.name, {}, {}};
  Robot& robot = made.robot;
  const engine::Mechanism& m = robot.mechanism = of.mechanism;
  robot.mobility = Mobility::mechanism_3;
  robot.chains = robot.motors = m.motors;
  robot.mechanism.home = of.home;
  robot.mechanism.platform = 5;
  robot.mechanism.described = 4;
  for (int i = 0; i < m.closures; ++i)
    robot.mechanism.closure[i].described = m.closures == 6 ? i / 2 : i;
  std::copy_n(of.home.begin() + m.motors, 3, robot.home.begin());
  std::copy_n(of.box.begin() + m.motors, 3, made.box.begin());
  const bool legs = m.closure[0].driven >= 0, arms = m.motors == 4;
  for (int i = 0; i < m.motors; ++i) {
    Chain& chain = robot.chain[i];
    chain.actuator = legs ? Actuator::telescopic : arms ? Actuator::revolute : Actuator::prismatic;
    chain.encoder_offset = 0.01 * i, chain.encoder_gain = i == 2 ? -0.8 : 1;
    if (arms)
      chain.eccentricity = {2, {0.01 * i, 0.005, 0, 0.002}};
    else
      chain.encoder_buildup = 0.05 * i;
  }
  const auto add = [&](Sensor one, int body = -1, bool at_anchor = false) {
    one.bar = body, one.at_nacelle = at_anchor;
    robot.sensor[robot.r++] = one;
  };
  using enum SensorKind;
  const int rod = arms ? 1 : 2;  // closure
  for (const bool at_anchor : {false, true})
    add(sensor(rod_in_plane, rod), -1, at_anchor), add(sensor(rod_lateral, rod), -1, at_anchor);
  add(sensor(rod_length, rod));
  add(sensor(coordinate, 0)), add(sensor(distance, 0), 3);
  add(sensor(arms ? joint_angle : slide_position, m.motors + 1));
  if (!arms) add(sensor(inclinometer, 0)), add(sensor(joint_angle, m.motors + 5));
  if (!arms) add(sensor(plane_distance, 0), 3), add(sensor(rotation, 0), 4);
  if (arms) add(sensor(motor_encoder, 1));
  CHECK(finish(robot) && finish_full(robot));
  return made;
}
}  // namespace

void for_each_described(const std::function<void(const Mechanism&)>& f) {
  std::vector<Described> all = described();
  all.back() = at_home("3-SPR", three_spr(), {0.5, 0.02, 0.03}, 0.1, 0.5);
  for (const Described& one : all) {
    check::state().scene = one.name;
    f(robot_of(one));
  }
}

}  // namespace mechanisms_described
