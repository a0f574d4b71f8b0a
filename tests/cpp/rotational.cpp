#include "rotational.hpp"

namespace pivots_tested {
Chain crank(const Vec3& base, const Vec3& B, const Vec3& A, const Vec3& carried_from) {
  Chain chain;
  const Vec3 p = B - base, v = B - A;
  chain.base = base;
  chain.axis = Vec3::UnitX();
  chain.zero = p.normalized();
  chain.arm = p.norm();
  chain.rod = v.norm();
  chain.pivot = A - carried_from;
  chain.working_mode = p.cross(v).x() > 0 ? 1 : -1;
  set_masses(chain, 0.002, 0.05, 0.03);
  return chain;
}

void give_foot(Mechanism& mechanism) {
  Robot& robot = mechanism.robot;
  add_body(robot, 0.6, Vec3(0.03, 0.002, -0.03), Vec3::Zero(), {0.0004, 0.002, 0.0018});
  robot.body[0].inertia(0, 1) = robot.body[0].inertia(1, 0) = 0.0001;
  robot.chains = robot.motors = dof(robot.mobility);
  robot.r = 2;
  robot.sensor[0].kind = SensorKind::inclinometer;
  robot.sensor[0].direction = Vec3::UnitY();
  robot.sensor[0].normal = Vec3::UnitZ();
  robot.sensor[1].kind = SensorKind::rod_in_plane;
  robot.sensor[1].chain = 0;
  robot.sensor[1].at_nacelle = true;
  robot.sensor[1].direction = Vec3::UnitX();
  robot.sensor[1].normal = Vec3::UnitZ();
  Sensor& encoder = robot.sensor[robot.r++];
  encoder.kind = SensorKind::axis_angle;
  encoder.axis = dof(robot.mobility) - 1;
  encoder.gain = -1.5;
  encoder.offset = 0.02;
  encoder.eccentricity.gear = 2;
  encoder.eccentricity.amplitude = {0.01, -0.02, 0.005, 0.004};
  const Outcome outcome = finish(robot);
  if (!outcome) std::printf("%s: home is %s\n", mechanism.name, describe(outcome.status));
}

Mechanism g1_ankle() {
  Mechanism mechanism{"G1 ankle", {}, {0.69813, 0.2618}};
  Robot& robot = mechanism.robot;
  robot.mobility = Mobility::rotational_2;
  const Vec3 roll(0, 0, -0.01756);
  robot.axis[0].direction = Vec3::UnitY();
  robot.axis[1].origin = roll;
  robot.axis[1].direction = Vec3::UnitX();
  robot.chain[0] =
      crank({0.035, 0, 0.15087}, {0.035, 0.01653, 0.1469}, {0.022, 0.015, -0.00956}, roll);
  robot.chain[1] =
      crank({0.0395, 0, 0.21587}, {0.0395, -0.01636, 0.21125}, {0.022, -0.015, -0.00956}, roll);
  robot.home = {-0.174535, 0};
  give_foot(mechanism);
  return mechanism;
}

Mechanism x1_ankle() {
  Mechanism mechanism{"X1 ankle", {}, {0.6, 0.35}};
  Robot& robot = mechanism.robot;
  robot.mobility = Mobility::rotational_2;
  robot.axis[0].direction = Vec3::UnitY();
  robot.axis[1].direction = Vec3::UnitX();
  const double rods[]{0.195, 0.14};
  for (int i = 0; i < 2; ++i) {
    const double side = i == 0 ? -1 : 1, r = 0.025;
    const Vec3 base(-0.041, 0, rods[i]), A(-0.041, side * r, 0.009);
    // p = r (0, side cos a, sin a) on the rod: d = A - base, |p - d| = L, the root with sin a > 0.
    const Vec3 d = A - base;
    const double c = (r * r + d.squaredNorm() - rods[i] * rods[i]) / (2 * r * d.norm());
    const double a = std::atan2(d.z(), side * d.y()) + std::acos(c);
    robot.chain[i] =
        crank(base, base + r * Vec3(0, side * std::cos(a), std::sin(a)), A, Vec3::Zero());
  }
  robot.home = {-0.1, 0};
  give_foot(mechanism);
  return mechanism;
}

Mechanism neck() {
  Mechanism mechanism{"neck", {}, {0.3, 0.25, 0.25}};
  Robot& robot = mechanism.robot;
  robot.mobility = Mobility::rotational_3;
  const Vec3 directions[]{{0.05, -0.02, 1}, {0.03, 1, 0.04}, {1, -0.05, 0.02}};
  const Vec3 origins[]{{0.002, 0.001, 0}, {0.004, -0.003, 0.03}, {-0.002, 0.005, 0.012}};
  Vec3 last = Vec3::Zero();
  for (int j = 0; j < 3; ++j) {
    robot.axis[j].direction = directions[j].normalized();
    robot.axis[j].origin = origins[j];
    last += origins[j];
  }
  for (int i = 0; i < 3; ++i) {
    const Vec3 out = polar(1, 20 + 120 * i), side = polar(1, 110 + 120 * i);
    const Vec3 base = 0.06 * out + Vec3(0, 0, -0.08 + 0.003 * i);
    robot.chain[i] = crank(base, base + 0.03 * side + Vec3(0, 0, 0.004 * i),
                           0.045 * out - 0.02 * side + Vec3(0, 0, 0.05), last);
    Chain& chain = robot.chain[i];
    chain.axis = out;
    chain.zero = (chain.zero - chain.zero.dot(out) * out).normalized();
    const Vec3 p = chain.arm * chain.zero, v = base + p - last - chain.pivot;
    chain.rod = v.norm();
    chain.working_mode = p.cross(v).dot(out) > 0 ? 1 : -1;
  }
  robot.home = {0.02, 0.03, -0.04};
  give_foot(mechanism);
  return mechanism;
}

Mechanism lever() {
  Mechanism mechanism{"lever", {}, {0.5}};
  Robot& robot = mechanism.robot;
  robot.mobility = Mobility::rotational_1;
  robot.axis[0].origin = Vec3(0.01, 0, 0.02);
  robot.axis[0].direction = Vec3(0.1, 1, -0.05).normalized();
  robot.chain[0] =
      crank({0.06, 0.01, 0.15}, {0.06, 0.04, 0.14}, {0.07, 0.03, 0.03}, robot.axis[0].origin);
  Chain& chain = robot.chain[0];
  chain.axis = Vec3::UnitY();
  chain.zero = Vec3::UnitX();
  chain.arm = 0.05;
  const Vec3 v = chain.base + 0.05 * Vec3::UnitX() - Vec3(0.07, 0.03, 0.03);
  chain.rod = v.norm();
  chain.working_mode = Vec3(0.05, 0, 0).cross(v).y() > 0 ? 1 : -1;
  robot.home = {0.05};
  give_foot(mechanism);
  return mechanism;
}

void for_each_pivot(const std::function<void(const Mechanism&)>& f) {
  static const std::vector<Mechanism> all{g1_ankle(), x1_ankle(), neck(), lever()};
  for_all(all, f);
}

void for_every(const std::function<void(const Mechanism&)>& f) {
  for_each(f);
  for_each_pivot(f);
}
}  // namespace pivots_tested
