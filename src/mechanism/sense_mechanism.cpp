#include "mechanism/sense_mechanism.hpp"

#include "mechanism/parameters.hpp"

namespace truepose {
SensedFreedoms sense(const Robot& robot, const Built& built, const engine::Position& at, Real theta,
                     const Sensor& sensor) {
  const engine::Mechanism& m = built.mechanism;
  const engine::Frame& platform = at.frame[built.platform];
  SensedFreedoms s;
  Sensed& sensed = s;
  if (on_chain(sensor)) {
    const int rod = built.rod_of(sensor), arm = built.arm[sensor.chain];
    const Chain& chain = robot.chain[sensor.chain];
    const Mat3& body = chain.bar < 0 ? platform.R : at.frame[built.bar[sensor.chain]].R;
    const bool revolute = chain.actuator == Actuator::revolute;
    const Vec3 p = revolute ? at.frame[arm].R * (chain.arm * chain.zero) : Vec3::Zero();
    sensed = sense_chain(sensor, {chain, at.y[sensor.chain], p, at.B[rod] - at.A[rod], body});
    // The frame of its joint turns with the platform's side or with the arm.
    s.platform = engine::line_through(at.A[rod], s.rod);
    engine::Line of_B = engine::line_through(at.B[rod], s.rod);
    if (sensor.at_nacelle)
      s.platform.moment += s.frame;
    else if (revolute)
      of_B.moment -= s.frame;
    engine::add_line(m, at, built.bar[sensor.chain], s.platform, 1, s.row);
    engine::add_line(m, at, arm, of_B, -1, s.row);
    s.row[sensor.chain] += s.motor;
    return s;
  }
  const auto read = [&](int freedom, Real sign) {
    s.value = sign * at.y[freedom];
    read_off_centre(sensor, s);
    s.row[freedom] = sign * s.slope;
    return s;
  };
  if (sensor.kind == SensorKind::axis_angle) return read(m.motors + sensor.axis, 1);
  if (properties(sensor.kind).is_theta) {
    if (sensor.bar >= 0 && built.layout != Layout::ideal)
      return read(built.turn_of(robot, sensor.bar), -1);
    if (built.yaw >= 0) return read(built.yaw, 1);
  }
  sensed = sense_pose(sensor, {platform.p, platform.R, theta});
  s.platform = engine::line_through(platform.p, s.linear);
  s.platform.moment += s.angular;
  engine::add_line(m, at, built.platform, s.platform, 1, s.row);
  return s;
}

Outcome read(const Robot& robot, const Built& built, const engine::Position& at, Real theta,
             Extended& q_e) {
  const int n = dof(robot.mobility);
  for (int i = 0; i < n; ++i) q_e[i] = motor_reading(robot.chain[i], at.y[i]);
  for (int k = 0; k < robot.r; ++k) {
    const Sensor& sensor = robot.sensor[k];
    if (built.layout == Layout::full && sensor.bar >= robot.full.bars)
      return {Status::not_measured, -1};
    q_e[n + k] = sensor.gain * sense(robot, built, at, theta, sensor).value - sensor.offset;
  }
  return {all_finite(q_e, n + robot.r) ? Status::ok : Status::not_finite, -1};
}

namespace {
/// All readings in one position and their derivatives.
struct Readings {
  const Robot& robot;
  const Built& built;
  const engine::Position& at;
  const int n = dof(robot.mobility), count = n + robot.r, width = parameter_count(robot);
  std::array<SensedFreedoms, kMaxSensors> sensed;
  std::array<engine::Row, kMaxReadings> e;      ///< e_u and e_x
  Matrix<kMaxReadings, engine::kClosures> S{};  ///< e_u A⁻¹
  Real* H = nullptr;                            ///< H_ξ

  Readings(const Robot& of, const Built& as, const engine::Position& there, Real theta)
      : robot(of), built(as), at(there) {
    for (int i = 0; i < n; ++i) {
      e[i].fill(0);
      e[i][i] = robot.chain[i].encoder_errs ? encode(robot.chain[i], at.y[i]).slope : 1;
    }
    for (int k = 0; k < robot.r; ++k) {
      const Sensor& sensor = robot.sensor[k];
      sensed[k] = sense(robot, built, at, theta, sensor);
      for (int j = 0; j < built.mechanism.freedoms; ++j)
        e[n + k][j] = sensor.gain * sensed[k].row[j];
    }
  }

  /// A parameter that changes f of a closure at fixed freedoms.
  void enter_closure(int closure, int column, Real f) {
    for (int c = 0; c < count && f != 0; ++c) H[c * width + column] -= S[c][closure] * f;
  }
  Real& entry(int sensor, int column) { return H[(n + sensor) * width + column]; }

  void chain_columns(int i);
  void axis_columns(int j);
  void parameter_columns(Real* H_xi);
};

/// Parameters of a chain displace points and lengths, at a fixed reading of its encoder.
void Readings::chain_columns(int i) {
  const Chain& chain = robot.chain[i];
  const int first = built.rods_per_chain * i, last = first + built.rods_per_chain - 1;
  const Mat3& platform = at.frame[built.platform].R;
  const Mat3& body = chain.bar < 0 ? platform : at.frame[built.bar[i]].R;
  const Vec3 p = 0.5 * (at.B[first] + at.B[last]) - chain.base;
  const Vec3 u = pair_direction(chain), drawn = body * chain.pair_drawn;
  const auto enter = [&](int column, const Variation& change) {
    H[i * width + column] -= change.motor;
    for (int rod = first; rod <= last; ++rod) {
      const Real half = first == last ? 0 : rod == first ? 0.5 : -0.5;
      const Vec3 pair = chain.rod_spacing * change.turn.cross(u) + change.spacing * u;
      const Vec3 gap = change.A - change.B + half * (change.spacing * drawn - pair);  // of A - B
      const Real longer = change.rod + half * change.difference;
      const Real length = engine::length_of(built.mechanism, at, rod);
      enter_closure(rod, column, at.line[rod].force.dot(gap) - length * longer);
      for (int k = 0; k < robot.r; ++k) {
        const Sensor& sensor = robot.sensor[k];
        if (!on_chain(sensor) || built.rod_of(sensor) != rod) continue;
        const Real turned = sensor.at_nacelle ? 0 : sensed[k].frame.dot(change.turn);
        entry(k, column) += sensor.gain * (sensed[k].rod.dot(gap) + turned);
      }
    }
  };
  const Real q = motor_reading(chain, at.y[i]);
  for_each_variation(robot, i, q, p, body, platform * chain.pivot, enter);
}

/// Parameters of a passive axis move the platform by a twist, the angles held: an origin shifts all
/// that follows it; a direction turned by δ ⟂ d turns it by sin x δ + (1 - cos x) d × δ about the
/// axis' origin.
void Readings::axis_columns(int j) {
  const int body = built.platform - n + 1 + j;
  const Mat3 R = j == 0 ? Mat3::Identity() : at.frame[body - 1].R;
  const Vec3 d = robot.axis[j].direction;
  const Real x = at.y[built.mechanism.motors + j];
  for (int k = 0; k < kAxisParameters; ++k) {
    const int column = axis_column(robot, j) + k;
    engine::Twist twist{R.col(k % 3), Vec3::Zero()};
    if (k >= static_cast<int>(AxisParameter::direction_x)) {
      const Vec3 turned = turned_only(Vec3::Unit(k % 3), d);
      twist.turn = R * (std::sin(x) * turned + (1 - std::cos(x)) * d.cross(turned));
      twist.velocity = at.frame[body].p.cross(twist.turn);
    }
    for (int rod = 0; rod < built.mechanism.closures; ++rod)
      enter_closure(rod, column, twist * at.line[rod]);
    for (int sensor = 0; sensor < robot.r; ++sensor)
      entry(sensor, column) += robot.sensor[sensor].gain * (twist * sensed[sensor].platform);
  }
}

void Readings::parameter_columns(Real* H_xi) {
  H = H_xi;
  std::fill(H, H + count * width, Real(0));
  for (int i = 0; i < n; ++i) chain_columns(i);
  for (int j = 0; j < passive_axes(robot.mobility); ++j) axis_columns(j);
  for (int k = 0; k < robot.r; ++k) sensor_columns(robot, k, sensed[k], H);
}
}  // namespace

Outcome linearise(const Robot& robot, const Built& built, const engine::Position& at, Real theta,
                  Extended& q_e, PoseRows& H_x, Real* H_xi) {
  if (const Outcome outcome = read(robot, built, at, theta, q_e); !outcome) return outcome;
  const engine::Mechanism& m = built.mechanism;
  for (int rod = 0; rod < m.closures; ++rod)
    if (engine::stretched(m, at, rod)) return {Status::singular, rod / built.rods_per_chain};
  const engine::Freedoms unknown = engine::inverse(m);
  const engine::Equations equations(m, at, unknown);
  if (!equations.regular()) return {Status::singular, -1};
  Readings by(robot, built, at, theta);
  for (int c = 0; c < by.count; ++c) std::copy_n(by.e[c].begin() + by.n, by.n, H_x[c].begin());
  for (int rod = 0; rod < m.closures; ++rod) {
    const Unknowns u = equations.column(rod);
    const engine::Row row = engine::row(m, at, rod);
    for (int c = 0; c < by.count; ++c) {
      by.S[c][rod] = sum_of(unknown.count, [&](int j) { return by.e[c][unknown.index[j]] * u[j]; });
      for (int j = 0; j < by.n; ++j) H_x[c][j] -= by.S[c][rod] * row[by.n + j];
    }
  }
  if (H_xi) by.parameter_columns(H_xi);
  return {};
}

void parameter_jacobian(const Robot& robot, const Closure& closure, Real* H) {
  Built built;
  build(robot, Layout::ideal, built);
  engine::Position at;
  at.y = stand(robot, built, closure.q(), closure.pose);
  engine::place(built.mechanism, at);
  Readings by(robot, built, at, closure.pose.theta);
  // Each motor follows its own rod alone. Near a singularity J_q is the closure's, damped.
  for (int c = 0; c < by.count; ++c)
    for (int i = 0; i < by.n; ++i)
      by.S[c][i] = by.e[c][i] * closure.chain[i].rate / closure.chain[i].jq;
  by.parameter_columns(H);
}
}  // namespace truepose
