// Damping at and near singularities, and the paper's law elsewhere.
#include "control/control.hpp"
#include "mechanisms.hpp"
#include "reference.hpp"
#include "simulation/statics.hpp"

using namespace mechanisms;

namespace {

using reference::Dense;

constexpr double kBand = 0.05;
const double kGain = 2 / (std::sqrt(3.0) * kBand);  ///< what no damped gain exceeds

/// A straight path of poses that crosses a singularity of type 2.
struct Crossing {
  Mechanism mechanism;
  Coordinates from, to;
};

/// An H4 with its arms at right angles, as one would draw it first; turned far it is singular.
Mechanism symmetric_h4() {
  Mechanism mechanism = h4();
  mechanism.name = "symmetric H4";
  constexpr double R = 0.14, h = 0.06, d = 0.06, alpha[]{0, 180, 270, 90};
  const Vec3 inner[]{{h, d, 0}, {-h, d, 0}, {-h, -d, 0}, {h, -d, 0}};
  for (int i = 0; i < 4; ++i) {
    Chain& chain = mechanism.robot.chain[i];
    chain.zero = polar(1, alpha[i]);
    chain.axis = Vec3::UnitZ().cross(chain.zero);
    chain.base = inner[i] + R * chain.zero;
  }
  if (!finish(mechanism.robot)) std::printf("%s: home is singular\n", mechanism.name);
  return mechanism;
}

/// Calls f(crossing) for each.
template <class F>
void for_each_crossing(F&& f) {
  const Crossing all[]{{five_bar(), {0.01, 0.33}, {0.01, 0.05}},
                       {planar("3-RRR", Actuator::revolute), {0.01, 0.02, 0.1}, {0.01, 0.02, 0.8}},
                       {symmetric_h4(), {0.03, 0.02, -0.35, -0.3}, {0.03, 0.02, -0.35, -1.2}}};
  for (const Crossing& crossing : all) {
    check::state().scene = crossing.mechanism.name;
    f(crossing);
  }
}

Coordinates between(const Crossing& crossing, double part) {
  Coordinates x{};
  for (int i = 0; i < kMaxDof; ++i)
    x[i] = crossing.from[i] + part * (crossing.to[i] - crossing.from[i]);
  return x;
}

/// The rods' unit lines in units of their columns, by their definition.
struct Lines {
  Dense A;
  Eigen::VectorXd unit;

  explicit Lines(const Closure& closure) {
    const int n = closure.carried.n, motors = closure.motors;
    A = Dense::Zero(motors, n);
    unit = Eigen::VectorXd::Zero(n);
    for (int i = 0; i < motors; ++i) {
      const Vec3 along = closure.chain[i].v.normalized(), lever = closure.chain[i].lever;
      const Vec3 moment = lever.cross(along);
      for (int j = 0; j < n; ++j) {
        const int column = free_columns(closure.carried.mobility)[j];
        A(i, j) = column < 3 ? along[column] : moment[column - 3];
        unit[j] += column < 3 ? 1 : lever.squaredNorm();
      }
    }
    unit = unit.cwiseSqrt();
    A *= unit.cwiseInverse().asDiagonal();
  }
};

double largest(int n, const Joint& values) {
  double result = 0;
  for (int i = 0; i < n; ++i) result = std::max(result, std::fabs(values[i]));
  return result;
}

}  // namespace

TEST_EACH(for_each,
          "the conditioning is n / (|A| |A⁻¹|) of the rods' lines, in metres or in millimetres") {
  check::Random random(91);
  for (int k = 0; k < 50; ++k) {
    Coordinates x = any_x(random);
    Joint serial{}, again{};
    Closure closure;
    CHECK(ikm(robot, to_pose(K, x), closure));
    const Dense A = Lines(closure).A;
    double parallel = 0, scaled = 0;
    CHECK(conditioning(robot, x, parallel, serial));
    CHECK_NEAR(parallel,
               n / (A.norm() * reference::solve(A, Dense::Identity(motors, motors)).norm()), 1e-12);
    CHECK(parallel > 0.4 && parallel <= 1);
    Robot large = robot;
    for (Chain& chain : large.chain) {
      for (Vec3* vector : {&chain.base, &chain.pivot, &chain.anchor}) *vector *= 1000;
      chain.arm *= 1000;
      chain.rod *= 1000;
    }
    for (int j = 0; j < n; ++j)
      if (free_columns(K)[j] < 3) x[j] *= 1000;
    CHECK(conditioning(large, x, scaled, again));
    CHECK_NEAR(parallel, scaled, 1e-12);
    for (int i = 0; i < motors; ++i) CHECK_NEAR(serial[i], again[i], 1e-10);
  }
}

TEST("in the band J is the damped least squares of its definition, and its gain is bounded") {
  for_each_crossing([](const Crossing& crossing) {
    const Mobility K = crossing.mechanism.robot.mobility;
    const int n = dof(K);
    int damped = 0;
    double exact_gain = 0;
    for (double part = 0; part <= 1; part += 1e-4) {
      Closure closure;
      CHECK(ikm(crossing.mechanism.robot, to_pose(K, between(crossing, part)), closure));
      const Lines lines(closure);
      const double c = Conditioning(closure).parallel(), size = lines.A.norm() / n;
      Jacobians jacobians;
      const Outcome outcome = jacobian(closure, kBand, jacobians);
      CHECK(outcome.status == (c < kBand ? Status::near_singular : Status::ok));
      if (outcome.status == Status::ok) continue;
      ++damped;
      const Dense A = lines.A / size;
      const double lambda2 = 0.25 * (kBand * kBand - c * c);
      const Dense gain =
          reference::solve(A.transpose() * A + lambda2 * Dense::Identity(n, n), A.transpose());
      CHECK(reference::singular_values(gain)[0] <= kGain * (1 + 1e-9));
      exact_gain = std::max(exact_gain, 1 / reference::singular_values(A)[n - 1]);
      for (int i = 0; i < n; ++i)
        for (int j = 0; j < n; ++j) {
          const double expected =
              gain(i, j) / (size * lines.unit[i]) * closure.chain[j].jq / closure.chain[j].v.norm();
          CHECK_NEAR(jacobians.J[i][j], expected, 1e-9 * (1 + std::fabs(expected)));
        }
    }
    CHECK(damped > 100);
    CHECK(exact_gain > 10 * kGain);
  });
}

TEST_EACH(for_each_overdriven, "with redundant motors J is the least squares of the damped rows") {
  const Robot& robot = mechanism.robot;
  check::Random random(62);
  int damped = 0;
  for (int sample = 0; sample < 100; ++sample) {
    Closure closure;
    CHECK(ikm(robot, to_pose(K, random_pose(mechanism, random)), closure));
    const Conditioning exact(closure);
    const double band = 1.05 * exact.least();
    if (exact.parallel() < band) continue;
    ++damped;
    Jacobians jacobians;
    CHECK(jacobian(closure, band, jacobians).status == Status::near_singular);
    Dense rows(motors, n);
    for (int i = 0; i < motors; ++i)
      for (int j = 0; j < n; ++j) rows(i, j) = jacobians.jx[i][j] / closure.chain[i].jq;
    const Dense J = reference::solve(rows.transpose() * rows, rows.transpose());
    for (int i = 0; i < n; ++i)
      for (int j = 0; j < motors; ++j)
        CHECK_NEAR(jacobians.J[i][j], J(i, j), 1e-9 * (1 + std::fabs(J(i, j))));
  }
  CHECK((damped > 10) == (robot.chain[0].actuator != Actuator::telescopic));  // no arm, no band
}

TEST("across a singularity of type 2 the torques stay bounded and steady, and the status warns") {
  for_each_crossing([](const Crossing& crossing) {
    const Mobility K = crossing.mechanism.robot.mobility;
    const int n = dof(K);
    const Robot& robot = crossing.mechanism.robot;
    for (const Law law : {Law::joint, Law::tej, Law::cartesian}) {
      if (law == Law::cartesian && K != Mobility::schoenflies) continue;
      ControlSettings exact;
      exact.law = law;
      CHECK(place_poles(robot, crossing.from, 100, 1, exact));
      ControlSettings damped = exact;
      damped.damped_below = kBand;
      double outside = 0, inside = 0, jump = 0, paper = 0;
      std::vector<Status> seen;
      ControlState last;
      for (double part = 0; part <= 1; part += 1e-4) {
        Setpoint setpoint{between(crossing, part), {0.1, 0.1}, {1, 1}};
        const Pose pose = moved(K, to_pose(K, setpoint.x), Coordinates{1e-4, 1e-4});
        Extended q_e{};
        CHECK(extended(Level::ideal, robot, pose, q_e));
        ControlState state, other;
        const Status status = control(robot, damped, setpoint, q_e, state).status;
        if (seen.empty() || seen.back() != status) seen.push_back(status);
        if (status == Status::branch_lost) continue;
        double& most = status == Status::ok ? outside : inside;
        most = std::max(most, largest(n, state.torque));
        for (int i = 0; i < n && last.started; ++i)
          jump = std::max(jump, std::fabs(state.torque[i] - last.torque[i]));
        last = state;
        if (status == Status::near_singular && control(robot, exact, setpoint, q_e, other))
          paper = std::max(paper, largest(n, other.torque));
      }
      // Well before the mode changes, in the band, and past it: held.
      CHECK((seen == std::vector{Status::ok, Status::near_singular, Status::branch_lost}));
      CHECK(inside < 2 * outside);
      CHECK(jump < 0.05 * outside);
      CHECK(paper > 5 * inside);
    }
  });
}

TEST_EACH(for_each,
          "where an arm stretches the motor rates stay bounded, and the status names the chain") {
  if (mechanism.robot.chain[0].actuator == Actuator::telescopic) return;
  Robot robot = mechanism.robot;
  robot.assembly_sign = 0;
  double in = 0, out = 3;  // m along y, to the edge of the workspace
  for (int k = 0; k < 60; ++k) {
    Coordinates x = robot.home;
    Joint q{};
    const double middle = 0.5 * (in + out);
    x[1] += middle;
    (ikm(Level::ideal, robot, x, q) ? in : out) = middle;
  }
  double paper = 0;
  for (double inside = 1e-14; inside < 1e-3; inside *= 2) {
    Coordinates x = robot.home, rate{};
    x[1] += in - inside;
    rate[1] = 1;
    Closure closure;
    Jacobians exact, damped;
    if (!ikm(robot, to_pose(K, x), closure)) continue;  // by a rounding
    if (jacobian(closure, exact)) paper = std::max(paper, largest(motors, exact.joint_rate(rate)));
    const Conditioning conditioning(closure);
    int stretched = 0;
    while (stretched < motors && conditioning.serial(stretched) >= kBand) ++stretched;
    const Closure as_is = closure;
    const Outcome outcome = jacobian(closure, kBand, damped);
    const bool dependent = conditioning.parallel() < kBand;
    CHECK(outcome.status == (stretched < motors || dependent ? Status::near_singular : Status::ok));
    if (!dependent) CHECK(outcome.chain == (stretched < motors ? stretched : -1));
    CHECK(all_finite(damped.joint_rate(rate), motors));
    for (int i = 0; i < motors; ++i)
      CHECK(std::fabs(damped.joint_rate(rate)[i]) * closure.chain[i].dB.norm() <=
            kGain * (1 + 1e-9));
    for (int i = 0; i < motors; ++i) {  // 1/s of its part s along the rod becomes s/(s² + λ²)
      const double size = as_is.chain[i].v.norm() * as_is.chain[i].dB.norm();
      const double s = as_is.chain[i].jq / size;
      const double lambda2 = s * s < kBand * kBand ? 0.25 * (kBand * kBand - s * s) : 0;
      CHECK_NEAR(damped.jq[i] / size * s, s * s + lambda2, 1e-12);
    }
    // Readings that see the motor, and all laws, follow the bounded rates.
    for (int k = 0; k < 2; ++k) {
      robot.sensor[k].kind = k == 0 ? SensorKind::rod_in_plane : SensorKind::motor_encoder;
      robot.sensor[k].chain = stretched % motors;
    }
    ControlSettings settings;
    settings.law = Law::tej;
    settings.damped_below = kBand;
    settings.kp.fill(10);
    settings.kd.fill(0.1);
    Extended q_e{};
    if (!extended(Level::ideal, robot, to_pose(K, x), q_e)) continue;
    ControlState state;
    CHECK(control(robot, settings, {x, {}, {1, 1}}, q_e, state));
    CHECK(all_finite(state.torque, motors) && largest(motors, state.torque) < 1e4);
  }
  CHECK(paper > 10 * kGain);
}

TEST("a damped setpoint settles, and says that it was damped") {
  for_each_crossing([](const Crossing& crossing) {
    const Robot& robot = crossing.mechanism.robot;
    StaticsSettings settings;
    settings.control.damped_below = kBand;
    Coordinates x{};
    CHECK(settle(robot, robot, settings, crossing.from, x).status == Status::ok);
    double part = 0, parallel = 1;
    Joint serial{};
    for (; parallel >= kBand; part += 1e-3)
      CHECK(conditioning(robot, between(crossing, part), parallel, serial));
    CHECK(settle(robot, robot, settings, between(crossing, part - 1e-3), x).status ==
          Status::near_singular);
  });
}
