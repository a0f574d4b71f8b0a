// Derivatives of all readings by all geometric parameters, H_ξ; order and names of ξ.
#include "mechanism/parameters.hpp"

namespace truepose {
int axis_column(const Robot& robot, int axis) {
  assert(axis >= 0 && axis <= joints_of(robot));
  return robot.chains * kChainParameters + kMaxBars + robot.r * kSensorParameters +
         axis * kAxisParameters;
}

int closure_column(const Robot& robot, int described) {
  return axis_column(robot, joints_of(robot)) + described * kClosureParameters;
}

namespace {
engine::Twist along(const Vec3& v) { return {v, Vec3::Zero()}; }
engine::Twist about(const Vec3& point, const Vec3& turn) { return {point.cross(turn), turn}; }

/// Derivative by a unit vector, which can only turn.
Vec3 turned_only(const Vec3& slope, const Vec3& unit) { return slope - slope.dot(unit) * unit; }

/// All readings in one position and their derivatives.
struct Readings {
  const Robot& robot;
  const Built& built;
  const engine::Position& at;
  const int n = dof(robot.mobility), m = robot.motors, count = readings(robot),
            width = parameter_count(robot);
  std::array<Sensed, kMaxSensors> sensed;
  std::array<std::array<SensedFreedoms::Side, 2>, kMaxSensors> side;
  std::array<engine::Row, kMaxReadings> e;      ///< e_u and e_x
  Matrix<kMaxReadings, engine::kClosures> S{};  ///< e_u A⁻¹
  const PredictionRows* const g;                ///< null, or H is P H_ξ
  const int first = g ? m : 0;                  ///< reading of H's first row
  Real* H = nullptr;                            ///< H_ξ

  Readings(const Robot& of, const Built& as, const engine::Position& there, Real theta,
           const PredictionRows* predicts)
      : robot(of), built(as), at(there), g(predicts) {
    for (int i : range(m)) {
      e[i].fill(0);
      e[i][i] = robot.chain[i].encoder_errs ? encode(robot.chain[i], at.y[i]).slope : 1;
    }
    for (int k : range(robot.r)) {
      const Sensor& sensor = robot.sensor[k];
      const SensedFreedoms s = sense(robot, built, at, theta, sensor);
      sensed[k] = s;
      side[k] = s.side;
      for (int j : range(built.mechanism.freedoms)) e[m + k][j] = sensor.gain * s.row[j];
    }
  }

  /// A parameter that changes f of a closure at fixed freedoms.
  void enter_closure(int closure, int column, Real f) {
    for (int c = first; c < count && f != 0; ++c)
      H[(c - first) * width + column] -= S[c][closure] * f;
  }
  Real& entry(int sensor, int column) { return H[(m + sensor - first) * width + column]; }
  /// A parameter that changes a motor's reading, the motor at rest.
  void enter_motor(int motor, int column, Real value) {
    if (!g) H[motor * width + column] = value;
    for (int k = 0; k < robot.r && g; ++k) H[k * width + column] -= (*g)[k][motor] * value;
  }

  /// A parameter that moves one end of a closure, A (0) or B (1), at fixed freedoms; with it turns
  /// the frame of a joint that a sensor reads there.
  void enter_end(int closure, int end, int column, const engine::Twist& twist) {
    enter_closure(closure, column, (end == 0 ? 1 : -1) * (twist * at.line[closure]));
    for (int k : range(robot.r))
      if (on_rod(robot.sensor[k]) && built.rod_of(robot.sensor[k]) == closure)
        entry(k, column) += robot.sensor[k].gain * (twist * side[k][end].line);
  }
  /// One that makes a rod longer.
  void enter_length(int closure, int column, Real longer) {
    enter_closure(closure, column, -engine::length_of(built.mechanism, at, closure) * longer);
  }

  /// A parameter that moves a body, and all that it carries, at fixed freedoms.
  void enter_twist(int body, int column, const engine::Twist& twist) {
    const engine::Mechanism& m_ = built.mechanism;
    for (int i : range(m_.closures)) {
      const engine::Closure& of = m_.closure[i];
      const int moved = engine::carries(m_, body, of.body_a) - engine::carries(m_, body, of.body_b);
      enter_closure(i, column, moved * (twist * at.line[i]));
    }
    for (int k : range(robot.r))
      for (const auto& of : side[k])
        if (engine::carries(m_, body, of.body))
          entry(k, column) += robot.sensor[k].gain * (twist * of.line);
  }

  void chain_columns(int i);
  void encoder_columns(int i);
  void joint_columns(int body, int first);
  void described_columns(int closure);
  void sensor_columns(int k);
  void parameter_columns(Real* H_xi);
};

/// Parameters of a chain displace the ends of its rods, at a fixed reading of its encoder.
void Readings::chain_columns(int i) {
  using enum ChainParameter;
  const Chain& chain = robot.chain[i];
  const Mat3& platform = at.frame[built.platform].R;
  const Mat3& body = chain.bar < 0 ? platform : at.frame[built.bar[i]].R;
  const auto column = [&](ChainParameter parameter) { return chain_column(i) + int(parameter); };
  for (int side : range(built.rods_per_chain)) {
    const int closure = built.rods_per_chain * i + side;
    const Real half = built.rods_per_chain == 1 ? 0 : side == 0 ? 0.5 : -0.5;
    for (int k : range(3)) {
      enter_end(closure, 1, column(base_x) + k, along(Vec3::Unit(k)));
      enter_end(closure, 0, column(anchor_x) + k, along(body.col(k)));
    }
    if (chain.actuator == Actuator::revolute)
      enter_end(closure, 1, column(arm), along(at.frame[built.arm[i]].R * chain.zero));
    if (chain.actuator != Actuator::telescopic) enter_length(closure, column(rod), 1);
    enter_end(closure, 1, column(yaw), about(chain.base, Vec3::UnitZ()));  // adds to α
    enter_end(closure, 1, column(tilt), about(chain.base, chain.zero));    // turns u about e
    enter_length(closure, column(rod_difference), half);
    enter_end(closure, 0, column(rod_spacing), along(half * (body * chain.pair_drawn)));
    enter_end(closure, 1, column(rod_spacing), along(half * pair_direction(chain)));
    if (chain.bar >= 0)  // c moves along itself
      enter_end(closure, 0, bar_column(robot, chain.bar),
                along((platform * chain.pivot).normalized()));
  }
  encoder_columns(i);
}

/// Parameters of a motor's encoder, the motor at rest. The gain scales from 0.
void Readings::encoder_columns(int i) {
  using enum ChainParameter;
  const Chain& chain = robot.chain[i];
  const bool revolute = chain.actuator == Actuator::revolute;
  const auto enter = [&](ChainParameter parameter, Real value, int next = 0) {
    enter_motor(i, chain_column(i) + int(parameter) + next, value);
  };
  const Real v = (motor_reading(chain, at.y[i]) + chain.encoder_offset) / chain.encoder_gain;
  enter(encoder_offset, -1);
  enter(encoder_gain, v);
  if (revolute) {
    const std::array<Real, 4> harmonic = harmonics(chain.eccentricity, at.y[i]);
    for (int k : range(4))
      enter(eccentricity_c1, chain.encoder_gain * harmonic[k] / chain.eccentricity.gear, k);
  } else {
    enter(encoder_buildup, -chain.encoder_gain * v * v / (1 + 2 * chain.encoder_buildup * v));
  }
}

/// Parameters of a sensor: offset, gain, mounting, encoder.
void Readings::sensor_columns(int k) {
  const Sensor& of = robot.sensor[k];
  const Sensed& s = sensed[k];
  Real* row = &entry(k, sensor_column(robot, k));
  row[int(SensorParameter::offset)] = -1;
  row[int(SensorParameter::gain)] = s.value;
  int column = int(SensorParameter::origin_x);
  const Vec3 direction = turned_only(s.direction, of.direction);
  const Vec3 normal = turned_only(s.normal, of.normal);
  for (const Vec3* vector : {&s.origin, &direction, &s.target, &normal})
    for (int axis : range(3)) row[column++] = of.gain * (*vector)[axis];
  if (!rotary(of)) return;
  for (const Real harmonic : harmonics(of.eccentricity, s.angle))
    row[column++] = of.gain * harmonic / of.eccentricity.gear;
}

/// Parameters of a joint move the body that it carries by a twist, the freedom held: an origin
/// shifts it; a zero moves it along or about the axis; a direction turned by δ ⟂ d turns it by
/// sin φ δ + (1 - cos φ) d × δ about the joint, or moves it by φ δ along a slide.
void Readings::joint_columns(int body, int first) {
  const engine::Body& joint = built.mechanism.body[body];
  const Vec3& d = joint.axis;
  const Real phi = joint.offset + joint.ratio * at.y[joint.freedom];
  const bool slides = joint.kind == engine::Kind::slide;
  const auto by = [&](const Vec3& v) {  // v in the parent, along a slide or about the joint
    const Vec3 moved = at.direction(joint.parent, v);
    return slides ? along(moved) : about(at.frame[body].p, moved);
  };
  for (int k : range(3))
    enter_twist(body, first + int(AxisParameter::origin_x) + k,
                along(at.direction(joint.parent, Vec3::Unit(k))));
  if (!slides && joint.kind != engine::Kind::hinge) return;  // no axis of its own
  for (int k : range(3)) {
    const Vec3 turned = turned_only(Vec3::Unit(k), d);
    enter_twist(body, first + int(AxisParameter::direction_x) + k,
                by(slides ? phi * turned : sin(phi) * turned + (1 - cos(phi)) * d.cross(turned)));
  }
  if (is_mechanism(robot.mobility)) enter_twist(body, first + int(AxisParameter::zero), by(d));
}

/// Parameters of a described closure, in one of its equations: its ends, its length, its hinge.
void Readings::described_columns(int closure) {
  using enum ClosureParameter;
  const engine::Closure& of = built.mechanism.closure[closure];
  const auto column = [&](ClosureParameter parameter) {
    return closure_column(robot, of.described) + int(parameter);
  };
  const ClosureParameter A = of.exchanged ? base_x : anchor_x, B = of.exchanged ? anchor_x : base_x;
  const Vec3 d = at.A[closure] - at.B[closure];
  for (int k : range(3)) {
    enter_end(closure, 0, column(A) + k, along(at.direction(of.body_a, Vec3::Unit(k))));
    enter_end(closure, 1, column(B) + k, along(at.direction(of.body_b, Vec3::Unit(k))));
    if (of.plane)
      enter_closure(closure, column(of.exchanged ? anchor_hinge_x : base_hinge_x) + k,
                    d.dot(at.direction(of.body_b, turned_only(Vec3::Unit(k), of.normal))));
  }
  if (!of.plane) enter_length(closure, column(length), 1);
}

void Readings::parameter_columns(Real* H_xi) {
  H = H_xi;
  std::fill(H, H + (count - first) * width, Real(0));
  for (int k = 0; k < robot.r && g; ++k)
    for (int i : range(m))
      for (int rod : range(built.mechanism.closures)) S[m + k][rod] -= (*g)[k][i] * S[i][rod];
  const bool described = is_mechanism(robot.mobility);
  for (int i : range(m)) described ? encoder_columns(i) : chain_columns(i);
  const int body = described ? 0 : built.platform + 1 - joints_of(robot);
  for (int j : range(joints_of(robot))) joint_columns(body + j, axis_column(robot, j));
  for (int i = 0; i < built.mechanism.closures && described; ++i) described_columns(i);
  for (int k : range(robot.r)) sensor_columns(k);
}
}  // namespace

Outcome linearise(const Robot& robot, const Built& built, const engine::Position& at, Real theta,
                  Extended& q_e, PoseRows& H_x, Real* H_xi, const PredictionRows* g) {
  if (const Outcome outcome = read(robot, built, at, theta, q_e); !outcome) return outcome;
  const engine::Mechanism& m = built.mechanism;
  for (int rod : range(m.closures))
    if (engine::stretched(m, at, rod)) return {Status::singular, rod / built.rods_per_chain};
  const engine::Freedoms unknown = engine::inverse(m);
  const engine::Equations equations(m, at, unknown);
  if (!equations.regular()) return {Status::singular};
  Readings by(robot, built, at, theta, g);
  for (int c : range(by.count)) copy_first(by.n, by.e[c].begin() + by.m, H_x[c]);
  // e_u u, for a motion u of the unknown freedoms
  const auto seen = [&](int c, const Unknowns& u) {
    return sum_of(unknown.count, [&](int j) { return by.e[c][unknown.index[j]] * u[j]; });
  };
  for (int j : range(by.n)) {
    std::array<Real, engine::kClosures> f;
    for (int rod : range(m.closures)) f[rod] = equations.by[rod][by.m + j];
    const Unknowns u = equations.solve(f.data());
    for (int c : range(by.count)) H_x[c][j] -= seen(c, u);
  }
  if (!H_xi) return {};
  for (int rod : range(m.closures)) {
    const Unknowns u = equations.column(rod);
    for (int c : range(by.count)) by.S[c][rod] = seen(c, u);
  }
  by.parameter_columns(H_xi);
  return {};
}

void parameter_jacobian(const Robot& robot, const Closure& closure, Real* H,
                        const PredictionRows* g) {
  Built built;
  engine::Position at;
  stand(robot, closure, built, at);
  Readings by(robot, built, at, closure.pose.theta, g);
  // Each motor follows its own rod alone. Near a singularity J_q is the closure's, damped.
  for (int c : range(by.count))
    for (int i : range(by.m)) by.S[c][i] = by.e[c][i] * closure.chain[i].rate / closure.chain[i].jq;
  by.parameter_columns(H);
}
}  // namespace truepose
