// Encoders: scale, offset, eccentricity and stops. Nothing; and a stop stops commands alone.
#include "control/control.hpp"
#include "mechanism/fkm.hpp"
#include "mechanisms.hpp"
#include "simulation/plant.hpp"

using namespace mechanisms;

namespace {

constexpr std::array<double, 4> kAmplitude{0.03, -0.02, 0.01, 0.015};

/// The robot with every revolute motor's encoder off its centre, in the order of the chains, and
/// with a gain of every motor but the first; one counts backwards.
Robot eccentric(Robot robot) {
  for (int i = 0; i < robot.motors; ++i) {
    std::array<double, 4> amplitude = kAmplitude;
    for (double& value : amplitude) value *= 1 + 0.3 * i;
    if (robot.chain[i].actuator == Actuator::revolute)
      robot.chain[i].eccentricity.amplitude = amplitude;
    else
      robot.chain[i].encoder_buildup = 0.03 * i;
    robot.chain[i].encoder_gain = i == 1 ? -1.3 : 1 + 0.2 * i;
  }
  CHECK(finish(robot));
  return robot;
}

}  // namespace

TEST("decoding undoes encoding, turns included, whatever the gear, up to the largest amplitudes") {
  Eccentricity encoder;
  CHECK(!encoder.any());
  const auto undone = [&](double tolerance) {
    CHECK(encoder.any());
    for (double angle = -20; angle < 20; angle += 0.01)
      CHECK_NEAR(decode(encoder, encode(encoder, angle).value), angle, tolerance);
  };
  encoder.amplitude = kAmplitude;
  for (const double gear : {1.0, 4.0}) encoder.gear = gear, undone(1e-14);
  encoder.gear = 1;
  for (int signs = 0; signs < 16; ++signs) {
    std::array<double, 4> amplitude;
    for (int k = 0; k < 4; ++k) amplitude[k] = signs >> k & 1 ? 0.1 : -0.1;
    encoder.amplitude = amplitude;
    undone(1e-13);
  }
}

TEST_EACH(for_each,
          "eccentricity and gain of encoders change no motion: the same torques give the same "
          "acceleration") {
  const Robot wobbly = eccentric(robot);
  check::Random random(61);
  for (int sample = 0; sample < 100; ++sample) {
    const Pose pose = any_pose(random);
    const Coordinates rate = random_joint(random, 0.5);
    const Joint torque = random_joint(random, 20);
    Coordinates a{}, b{};
    CHECK(forward_dynamics(robot, pose, rate, torque, a));
    CHECK(forward_dynamics(wobbly, pose, rate, torque, b));
    for (int i = 0; i < n; ++i) CHECK_NEAR(a[i], b[i], 1e-9 * (1 + std::fabs(a[i])));
    Closure closure;
    Jacobians jacobians;
    DynamicModel model;
    CHECK(ikm(wobbly, pose, closure) && jacobian(closure, jacobians));
    CHECK(dynamic_model(wobbly, closure, rate, model));
    const Joint again = inverse_dynamics(model, jacobians.J, b);
    for (int i = 0; i < n && motors == n; ++i) CHECK_NEAR(again[i], torque[i], 1e-9);
  }
}

TEST("a motor reads its gain times its encoder's angle, less its offset, and is decoded again") {
  Chain chain;
  chain.encoder_gain = -1.02;
  chain.encoder_offset = 0.1;
  for (const bool off_centre : {false, true}) {
    Robot robot = h4().robot;
    if (off_centre) chain.eccentricity.amplitude = kAmplitude;
    robot.chain[2] = chain;
    note_encoders(robot);
    const double angle = encode(chain.eccentricity, 0.7).value;
    CHECK_NEAR(motor_reading(robot.chain[2], 0.7), -1.02 * angle - 0.1, 1e-15);
    CHECK_NEAR(motor_position(robot.chain[2], -1.02 * angle - 0.1), 0.7, 1e-14);
  }
}

TEST("a spool's line is as long as its layers, and a motor beyond its turning point is no NaN") {
  const double radius = 0.02, thickness = 0.002, turns = 7;
  Chain chain;
  chain.actuator = Actuator::telescopic;
  chain.encoder_gain = 1 / radius;  // of the spool's angle
  chain.encoder_buildup = thickness / (4 * std::numbers::pi * radius * radius);
  double length = 0;  // of all layers, each half a thickness further out on average
  const int parts = 100000;
  const double angle = 2 * std::numbers::pi * turns, step = angle / parts;
  for (int k = 0; k < parts; ++k)
    length += step * (radius + thickness * (k + 0.5) * step / (2 * std::numbers::pi));
  CHECK_NEAR(decode(chain, angle), length, 1e-9);
  for (const double beta : {chain.encoder_buildup, Real(0), Real(-0.1)}) {
    chain.encoder_buildup = beta;
    for (double at = 0.01; at < 2; at += 0.01) {
      const Encoded read = encode(chain, at), next = encode(chain, at + 1e-6);
      CHECK_NEAR(decode(chain, read.value), at, 1e-12);
      CHECK_NEAR(read.slope, (next.value - read.value) / 1e-6, 1e-3 * read.slope);
    }
  }
  chain.encoder_buildup = -1;
  CHECK(std::isfinite(encode(chain, 3).value) && std::isfinite(encode(chain, 3).slope));
}

TEST_EACH(for_each, "conditioning and pole placement do not depend on how an encoder counts") {
  const Robot robot = eccentric(mechanism.robot);
  double plain = 0, scaled = 0;
  Joint serial{}, again{};
  CHECK(conditioning(mechanism.robot, robot.home, plain, serial));
  CHECK(conditioning(robot, robot.home, scaled, again));
  CHECK_NEAR(plain, scaled, 1e-12);
  ControlSettings one, other;
  CHECK(place_poles(mechanism.robot, robot.home, 100, 1, one));
  CHECK(place_poles(robot, robot.home, 100, 1, other));
  Joint q{};
  CHECK(ikm(Level::ideal, robot, robot.home, q));
  for (int i = 0; i < robot.motors; ++i) {
    CHECK_NEAR(serial[i], again[i], 1e-12);
    // The same torque for the same error of the motor: kp per reading, slope readings per angle.
    const double slope = driven_point(robot.chain[i], q[i]).rate;
    if (motors == n)  // else J weighs the readings alike, in their units
      CHECK_NEAR(other.kp[i] / slope, one.kp[i], 1e-9 * one.kp[i]);
  }
}

TEST_EACH(for_each,
          "a motor that would pass its stops is named; what it does beyond them is still told") {
  Robot robot = eccentric(mechanism.robot);
  Coordinates x = robot.home;
  Joint q{};
  CHECK(ikm(Level::ideal, robot, robot.home, q));
  for (int i = 0; i < motors; ++i)
    for (const bool above : {true, false}) {
      Robot limited = robot;
      Chain& chain = limited.chain[i];
      chain.encoder_offset += 0.3;  // stops do not see it
      const double at = motor_position(robot.chain[i], q[i]);
      (above ? chain.low : chain.high) = at - (above ? 1e-9 : -1e-9);
      CHECK(finish(limited));
      (above ? chain.low : chain.high) = at + (above ? 1e-9 : -1e-9);
      const Outcome home = finish(limited);
      CHECK(home.status == Status::joint_limit && home.chain == i);
      Joint beyond{};
      CHECK(ikm(Level::ideal, limited, robot.home, beyond).status == Status::joint_limit);
      CHECK_NEAR(beyond[i], q[i] - 0.3, 1e-12);
      CHECK(fkm(Level::ideal, limited, beyond, x));
      JointMatrix J;
      CHECK(jacobian(Level::ideal, limited, robot.home, J));
      ControlState state;
      state.torque.fill(7);
      Extended q_e{};
      const Outcome refused = control(limited, {}, {robot.home, {}, {}}, q_e, state);
      CHECK(refused.status == Status::joint_limit && refused.chain == i);
      CHECK(state.torque[0] == 7 && !state.started);
    }
}
