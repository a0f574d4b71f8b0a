// Equations of motion. Power, energy, symmetry, order of accuracy.
#include "energy.hpp"
#include "mechanism/geometry.hpp"
#include "rotational.hpp"
#include "simulation/plant.hpp"

using namespace pivots_tested;

namespace {

/// A state inside the workspace: pose, free twist of about 0.5 m/s and 2 rad/s.
PlantState random_state(const Mechanism& mechanism, check::Random& random) {
  const Mobility K = mechanism.robot.mobility;
  PlantState state{to_pose(K, random_pose(mechanism, random, reach(K))), {}};
  for (int i = 0; i < dof(K); ++i)
    state.rate[i] = (!is_rotational(K) && i < positions_of(K) ? 0.5 : 2) * random();
  return state;
}

/// The state after a time h of constant acceleration, to second order in h.
PlantState along(Mobility K, const PlantState& start, const Coordinates& acceleration, double h) {
  PlantState state = start;
  Coordinates step{};
  for (int i = 0; i < dof(K); ++i) {
    step[i] = h * (start.rate[i] + 0.5 * h * acceleration[i]);
    state.rate[i] += h * acceleration[i];
  }
  state.pose = moved(K, start.pose, step);
  return state;
}

DynamicModel model_at(const Robot& robot, const PlantState& state, Jacobians& jacobians) {
  Closure closure;
  DynamicModel model;
  CHECK(ikm(robot, state.pose, closure));
  CHECK(jacobian(closure, jacobians));
  CHECK(dynamic_model(robot, closure, state.rate, model));
  return model;
}

double total_energy(const Robot& robot, const PlantState& state) {
  Energy result;
  CHECK(energy(robot, state.pose, state.rate, result));
  return result.kinetic + result.potential;
}

}  // namespace

TEST_EACH(for_each, "the mass matrix is symmetric and positive definite") {
  check::Random random(51);
  for (int k = 0; k < 200; ++k) {
    Jacobians jacobians;
    const auto model = model_at(robot, random_state(mechanism, random), jacobians);
    for (int trial = 0; trial < 20; ++trial) {
      const Coordinates rate = random_joint(random, 1);
      double twice_kinetic = 0, size = 0;
      for (int i = 0; i < n; ++i)
        for (int j = 0; j < n; ++j) {
          CHECK(model.mass[i][j] == model.mass[j][i]);
          twice_kinetic += rate[i] * model.mass[i][j] * rate[j];
          size += i == j ? rate[i] * rate[i] * model.mass[i][i] : 0;
        }
      CHECK(twice_kinetic > 1e-3 * size);
    }
  }
}

TEST_EACH(for_every, "the torques of an acceleration give that acceleration, friction included") {
  Robot robot = mechanism.robot;
  for (int i = 0; i < motors; ++i) {
    robot.chain[i].viscous = 0.1 + 0.02 * i;
    robot.chain[i].coulomb = 0.05 * i;
  }
  check::Random random(52);
  for (int k = 0; k < 200; ++k) {
    const PlantState state = random_state(mechanism, random);
    const Coordinates wanted = random_joint(random, 20);
    Jacobians jacobians;
    const auto model = model_at(robot, state, jacobians);
    Coordinates acceleration{};
    Joint torque = inverse_dynamics(model, jacobians.J, wanted), whole{};
    for (int i = 0; i < motors; ++i) torque[i] += friction(robot.chain[i], model.rate[i]);
    CHECK(forward_dynamics(robot, state.pose, state.rate, torque, acceleration));
    CHECK(inverse_dynamics(robot, state.pose, state.rate, wanted, whole));
    for (int i = 0; i < n; ++i) CHECK_NEAR(acceleration[i], wanted[i], 1e-10);
    for (int i = 0; i < motors; ++i) CHECK_NEAR(whole[i], torque[i], 1e-10);
  }
}

TEST_EACH(for_each,
          "the model's motor rates and accelerations are derivatives of the inverse model") {
  // With a unit of inertia on each motor and nothing else, torque is the motor's acceleration; of
  // redundant motors, its part that needs a force of the platform.
  Robot robot = mechanism.robot;
  robot.bodies = 0;
  robot.gravity = Vec3::Zero();
  for (int i = 0; i < motors; ++i) set_masses(robot.chain[i], 1, 0, 0);
  check::Random random(53);
  for (int k = 0; k < 100; ++k) {
    const PlantState state = random_state(mechanism, random);
    const Coordinates acceleration = random_joint(random, 5);
    Jacobians jacobians;
    const auto model = model_at(robot, state, jacobians);
    const Joint qdd = inverse_dynamics(model, jacobians.J, acceleration);
    const double h = 1e-4;
    Closure before, at, after;
    CHECK(ikm(robot, along(K, state, acceleration, -h).pose, before));
    CHECK(ikm(robot, state.pose, at));
    CHECK(ikm(robot, along(K, state, acceleration, h).pose, after));
    Joint seen{};
    for (int i = 0; i < motors; ++i) {
      const double q0 = before.chain[i].q, q1 = at.chain[i].q, q2 = after.chain[i].q;
      CHECK_NEAR(model.rate[i], (q2 - q0) / (2 * h), 2e-5 * (1 + std::fabs(qdd[i])));
      seen[i] = (q2 - 2 * q1 + q0) / (h * h);
    }
    if (motors > n) seen = jacobians.joint_rate(pose_rate(jacobians, seen));
    for (int i = 0; i < motors; ++i) CHECK_NEAR(qdd[i], seen[i], 2e-5 * (1 + std::fabs(qdd[i])));
  }
}

TEST_EACH(for_every, "energy grows at the power of the motors' torques") {
  check::Random random(54);
  for (int k = 0; k < 200; ++k) {
    const PlantState state = random_state(mechanism, random);
    const Joint torque = random_joint(random, 5);
    Coordinates acceleration{};
    CHECK(forward_dynamics(robot, state.pose, state.rate, torque, acceleration));
    Jacobians jacobians;
    const auto model = model_at(robot, state, jacobians);
    double power = 0;
    for (int i = 0; i < motors; ++i) power += torque[i] * model.rate[i];
    const double h = 1e-5;
    const double slope = (total_energy(robot, along(K, state, acceleration, h)) -
                          total_energy(robot, along(K, state, acceleration, -h))) /
                         (2 * h);
    CHECK_NEAR(slope, power, 1e-5 * (1 + std::fabs(power)));
  }
}

TEST_EACH(for_each, "at rest the bias is the slope of the potential energy") {
  Robot robot = mechanism.robot;
  robot.gravity = Vec3(1, -2, -9);  // as if mounted askew
  check::Random random(55);
  for (int k = 0; k < 100; ++k) {
    const PlantState state{any_pose(random), {}};
    Jacobians jacobians;
    const auto model = model_at(robot, state, jacobians);
    for (int i = 0; i < n; ++i) {
      const auto potential = [&](double h) {
        PlantState there = state;
        Coordinates step{};
        step[i] = h;
        there.pose = moved(K, state.pose, step);
        return total_energy(robot, there);
      };
      const double h = 1e-4;
      const double slope =
          (8 * (potential(h) - potential(-h)) - (potential(2 * h) - potential(-2 * h))) / (12 * h);
      CHECK_NEAR(model.bias[i], slope, 1e-8);
    }
  }
}

TEST("a plant that leaves its workspace says so and keeps its last good state") {
  const Mechanism mechanism = five_bar();
  constexpr Mobility K = Mobility::planar_translation;
  PlantState state{to_pose(K, mechanism.robot.home), {}};
  Outcome outcome;
  for (int k = 0; k < 2000 && outcome; ++k)
    outcome = advance(mechanism.robot, Joint{}, 1e-3, 1, state);
  CHECK(outcome.status == Status::unreachable || outcome.status == Status::singular);
  CHECK(state.pose.D.allFinite() && all_finite(state.rate, dof(K)));
  Closure closure;
  CHECK(ikm(mechanism.robot, state.pose, closure));
}

TEST("friction opposes motion: viscous in proportion, Coulomb's at its full size") {
  Chain chain;
  chain.viscous = 0.5;
  CHECK_NEAR(friction(chain, 2), 1, 0);
  chain.coulomb = 0.3;
  CHECK_NEAR(friction(chain, 2), 1.3, 1e-15);
  CHECK_NEAR(friction(chain, -2), -1.3, 1e-15);
  CHECK_NEAR(friction(chain, 0), 0, 0);
}

TEST("a bar's mass follows its pivot, which is a parameter") {
  constexpr Mobility K = Mobility::schoenflies;
  Robot drawn = h4().robot;
  drawn.body[1].bar = 0;
  drawn.body[2].bar = 1;
  std::vector<double> xi(parameter_count(drawn));
  CHECK(drawn_parameters(drawn, xi.data()));
  const double moved_by[2] = {0.01, -0.004};
  double more = 0;  // of the inertia about z
  for (int bar = 0; bar < 2; ++bar) {
    double& pivot = xi[bar_column(drawn, bar)];
    more += drawn.body[bar + 1].mass * (std::pow(pivot + moved_by[bar], 2) - pivot * pivot);
    pivot += moved_by[bar];
  }
  Robot robot = drawn;
  CHECK(set_parameters(drawn, xi.data(), robot));
  CHECK_NEAR((robot.body[0].pivot - drawn.body[0].pivot).norm(), 0, 0);
  CHECK_NEAR((robot.body[1].pivot - robot.chain[0].pivot).norm(), 0, 1e-15);
  CHECK_NEAR((robot.body[2].pivot - robot.chain[1].pivot).norm(), 0, 1e-15);
  Robot light = robot;  // the same chains, the bars where they were drawn
  for (int bar = 0; bar < 2; ++bar) light.body[bar + 1] = drawn.body[bar + 1];
  const PlantState at_home{to_pose(K, drawn.home), {}};
  Jacobians jacobians;
  CHECK_NEAR(model_at(robot, at_home, jacobians).mass[3][3] -
                 model_at(light, at_home, jacobians).mass[3][3],
             more, 1e-15);
}

TEST_EACH(for_each, "a rod moves as its points do, between B and A") {
  Robot robot = mechanism.robot;  // of nothing but rods
  robot.bodies = 0;
  for (int i = 0; i < motors; ++i) set_masses(robot.chain[i], 0, 0, 0.1 * (i + 1));
  check::Random random(58);
  for (int sample = 0; sample < 20; ++sample) {
    const PlantState state = random_state(mechanism, random);
    constexpr double h = 1e-5;
    Closure before, after;
    CHECK(ikm(robot, along(K, state, {}, -h).pose, before));
    CHECK(ikm(robot, along(K, state, {}, h).pose, after));
    double kinetic = 0;  // by Simpson's rule, exact for squares
    for (int i = 0; i < motors; ++i)
      for (const double s : {0.0, 0.5, 1.0}) {
        const auto point = [&](const Closure& at) -> Vec3 {
          return at.chain[i].p - s * at.chain[i].v;
        };
        const Vec3 velocity = (point(after) - point(before)) / (2 * h);
        kinetic += robot.chain[i].rod_mass / 2 * (s == 0.5 ? 4 : 1) / 6 * velocity.squaredNorm();
      }
    Energy result;
    CHECK(energy(robot, state.pose, state.rate, result));
    CHECK_NEAR(result.kinetic, kinetic, 1e-6 * kinetic);
  }
}

TEST_EACH(for_each, "dynamics of a known acceleration, without the mass matrix, are M ẍ + c") {
  check::Random random(59);
  for (int k = 0; k < 100; ++k) {
    const PlantState state = random_state(mechanism, random);
    const Coordinates acceleration = random_joint(random, 20);
    Closure closure;
    DynamicModel whole, known;
    CHECK(ikm(robot, state.pose, closure));
    CHECK(dynamic_model(robot, closure, state.rate, whole));
    CHECK(dynamic_model(robot, closure, state.rate, known, &acceleration));
    for (int i = 0; i < n; ++i) {
      double force = whole.bias[i], size = std::fabs(whole.bias[i]);
      for (int j = 0; j < n; ++j) {
        force += whole.mass[i][j] * acceleration[j];
        size += std::fabs(whole.mass[i][j] * acceleration[j]);
      }
      CHECK_NEAR(known.bias[i], force, 1e-12 * (1 + size));
    }
  }
}

TEST_EACH(for_each_overdriven,
          "of all torques of redundant motors that accelerate the platform, the model's are the "
          "smallest") {
  check::Random random(60);
  for (int k = 0; k < 50; ++k) {
    const PlantState state = random_state(mechanism, random);
    const Coordinates wanted = random_joint(random, 20);
    Jacobians jacobians;
    const auto model = model_at(robot, state, jacobians);
    const Joint torque = inverse_dynamics(model, jacobians.J, wanted);
    Joint other;
    for (double& entry : other) entry = random();
    const Joint moves = jacobians.joint_rate(pose_rate(jacobians, other));
    double along = 0, size = 0;
    for (int i = 0; i < motors; ++i) {  // what only stresses the robot is normal to them
      along += torque[i] * (other[i] - moves[i]);
      size += std::fabs(torque[i]);
    }
    CHECK_NEAR(along, 0, 1e-10 * (1 + size));
  }
}
