// One control cycle, and its torque without an answer.
#include "controllers.hpp"

using namespace mechanisms;

TEST_EACH(
    for_each,
    "whatever fails, the last torque is held, nothing else changes, and the status says why") {
  for (const Law law : kLaws) {
    ControlSettings settings = settings_for(robot, law);
    settings.ki.fill(1);
    Prior prior(robot);
    const Weighing weighing = prior.weighing();
    const Setpoint at_home{robot.home, {}, {}};
    Extended q_e = readings_at(robot, robot.home);
    q_e[0] += 1e-3;
    ControlState state;
    CHECK(control(robot, settings, at_home, q_e, state, weighing));
    const ControlState good = state;
    const auto check_held = [&](const Outcome& outcome, Status expected) {
      CHECK(outcome.status == expected);
      CHECK(state.torque == good.torque && state.error == good.error);
      CHECK(state.position == good.position && state.rate == good.rate);
      CHECK(state.integral == good.integral && state.started);
    };
    for (const double bad : {double(NAN), HUGE_VAL, -HUGE_VAL}) {
      for (int c = 0; c < (law == Law::joint ? motors : readings(robot)); ++c) {  // that it uses
        Extended broken = q_e;
        broken[c] = bad;
        check_held(control(robot, settings, at_home, broken, state, weighing), Status::not_finite);
      }
      for (int i = 0; i < n; ++i) {
        Setpoint x = at_home, rate = at_home, acceleration = at_home;
        x.x[i] = rate.rate[i] = acceleration.acceleration[i] = bad;
        for (const Setpoint& broken : {x, rate, acceleration})
          check_held(control(robot, settings, broken, q_e, state, weighing), Status::not_finite);
      }
    }
    Setpoint far = at_home;
    far.x[1] += 5;
    if (robot.chain[0].actuator != Actuator::telescopic)
      check_held(control(robot, settings, far, q_e, state, weighing), Status::unreachable);
    Robot other = robot;
    other.assembly_sign = -robot.assembly_sign;
    if (motors == n)  // else modes are not told apart
      check_held(control(other, settings, at_home, q_e, state, weighing), Status::branch_lost);
    ControlSettings broken = settings;
    broken.kp[0] = double(NAN);
    check_held(control(robot, broken, at_home, q_e, state, weighing), Status::not_finite);
    if (!properties(law).weighs) continue;
    check_held(control(robot, settings, at_home, q_e, state), Status::not_measured);
    for (const double sigma : {0.0, -1.0, double(NAN)}) {
      prior.known().sigma[0] = sigma;
      check_held(control(robot, settings, at_home, q_e, state, weighing), Status::not_finite);
    }
  }
}

TEST("a singular setpoint holds the torque too") {
  const Robot robot = meeting_legs();
  const ControlSettings settings = settings_for(robot, Law::tej);
  Extended q_e{};
  CHECK(extended(Level::ideal, robot, Pose{}, q_e));
  ControlState state;
  state.torque = {1, 2, 3};
  CHECK(control(robot, settings, Setpoint{}, q_e, state).status == Status::singular);
  CHECK(state.torque == (Joint{1, 2, 3}) && !state.started);
}

TEST_EACH(for_each,
          "without redundant readings a law of these is not measured; joint control needs none") {
  Robot robot = mechanism.robot;
  robot.r = 0;
  const Setpoint at_home{robot.home, {}, {}};
  Extended q_e = readings_at(robot, robot.home);
  for (const Law law : kLaws) {
    ControlState state;
    Prior prior(robot);
    const Outcome outcome =
        control(robot, settings_for(robot, law), at_home, q_e, state, prior.weighing());
    CHECK(outcome.status == (law == Law::joint || motors > n ? Status::ok : Status::not_measured));
  }
}

TEST(
    "a scale of the readings' sigma is a knowledge with larger sigmas, for laws that weigh alone") {
  const Robot robot = h4().robot;
  const Setpoint at_home{robot.home, {}, {}};
  Extended q_e = readings_at(robot, robot.home);
  for (int c = 0; c < 5; ++c) q_e[c] += 1e-3 * (c - 1);
  for (const Law law : kLaws) {
    Prior prior(robot);
    ControlSettings settings = settings_for(robot, law), scaled = settings;
    scaled.sigma_scale = 30;
    ControlState plain, by_scale, by_sigma;
    CHECK(control(robot, settings, at_home, q_e, plain, prior.weighing()));
    CHECK(control(robot, scaled, at_home, q_e, by_scale, prior.weighing()));
    for (double& sigma : prior.known().sigma) sigma *= 30;
    CHECK(control(robot, settings, at_home, q_e, by_sigma, prior.weighing()));
    CHECK(by_scale.error == by_sigma.error);
    CHECK((by_scale.error == plain.error) == !properties(law).weighs);
  }
}

TEST("an integral adds ki times the error's sum where no limit is met") {
  const Robot robot = five_bar().robot;
  ControlSettings settings = settings_for(robot, Law::joint);
  settings.feed_forward = FeedForward::none;
  settings.kp.fill(0);
  settings.kd.fill(0);
  settings.ki.fill(10);
  const Setpoint at_home{robot.home, {}, {}};
  Extended q_e = readings_at(robot, robot.home);
  q_e[0] -= 0.02;
  ControlState state;
  for (int k = 1; k <= 100; ++k) {
    CHECK(control(robot, settings, at_home, q_e, state));
    CHECK_NEAR(state.torque[0], 10 * 0.02 * 1e-3 * k, 1e-12);
    CHECK_NEAR(state.torque[1], 0, 1e-12);
  }
}

TEST("a saturated motor commands its limit, and does not wind up") {
  constexpr double kLimit = 30;
  Robot robot = h4().robot;
  for (Chain& chain : robot.chain) chain.torque_limit = kLimit;
  ControlSettings settings = settings_for(robot, Law::joint);
  for (int i = 0; i < 4; ++i) settings.ki[i] = 50 * settings.kp[i];
  const Setpoint at_home{robot.home, {}, {}};
  const Extended there = readings_at(robot, robot.home);
  Extended away = there;
  for (int i = 0; i < 4; ++i) away[i] += i % 2 ? 0.5 : -0.5;
  ControlState wound, fresh;
  for (int k = 0; k < 1000; ++k) {
    CHECK(control(robot, settings, at_home, away, wound));
    for (int i = 0; i < 4; ++i) CHECK(wound.torque[i] == (i % 2 ? -kLimit : kLimit));
  }
  for (int k = 0; k < 100; ++k)
    for (ControlState* state : {&wound, &fresh})
      CHECK(control(robot, settings, at_home, there, *state));
  for (int i = 0; i < 4; ++i) CHECK_NEAR(wound.torque[i], fresh.torque[i], 0.05);
}

TEST("the tracking loop finds by which rate a ramp falls behind, whatever its bandwidth") {
  for (const double bandwidth : {50.0, 1000.0, 1e5}) {
    ControlSettings settings;
    settings.velocity_bandwidth = bandwidth;
    const double pole = std::exp(-bandwidth * settings.period);
    double position = 0.3, rate = 0, reading = 0;
    for (int k = 0; k < 2000; ++k) {
      reading = 0.3 + 2.5 * k * settings.period;
      track(settings, pole, reading, 3.0, position, rate);
    }
    CHECK_NEAR(rate, 0.5, 1e-9);
    CHECK_NEAR(position, reading, 1e-9);
  }
}

TEST("on the estimate, a hexapod that turns through a right angle is damped by its true twist") {
  constexpr Mobility K = Mobility::spatial;
  const Robot robot = hexapod("6-UPS", Actuator::telescopic).robot;
  Prior prior(robot);
  ControlSettings settings = settings_for(robot, Law::estimated);
  settings.feed_forward = FeedForward::none;
  const Coordinates twist{0.02, -0.01, 0.03, 0.3, -0.5, 1.0};
  ControlState state;
  Pose pose = moved(K, to_pose(K, robot.home), {0, 0, 0, 0.3, 0.2, -0.4});
  Coordinates step{};
  for (int i = 0; i < 6; ++i) step[i] = twist[i] * settings.period;
  for (int k = 0; k < 600; ++k) {
    Setpoint setpoint{to_coordinates(K, pose), {}, {}};
    Extended q_e = readings_at(robot, pose);
    CHECK(control(robot, settings, setpoint, q_e, state, prior.weighing()));
    pose = moved(K, pose, step);
  }
  for (int i = 0; i < 6; ++i) CHECK_NEAR(state.rate[i], -twist[i], 1e-6);
}

TEST_EACH(for_each, "a setpoint that jumps, and a controller switched on in motion, kick no rate") {
  check::Random random(87);
  for (const Law law : kLaws) {
    ControlSettings settings = settings_for(robot, law);
    settings.feed_forward = FeedForward::none;
    Prior prior(robot);
    Setpoint still, away;
    still.x = robot.home;
    Coordinates step{};
    for (int i = 0; i < n; ++i) {
      step[i] = 1e-3 * random();
      still.rate[i] = 0.1 * random();
    }
    away.x = to_coordinates(K, moved(K, to_pose(K, robot.home), step));
    Extended q_e = readings_at(robot, robot.home);
    ControlState state;
    const auto pushes_alone = [&](const Setpoint& setpoint) {
      CHECK(control(robot, settings, setpoint, q_e, state, prior.weighing()));
      for (const double rate : state.rate) CHECK_NEAR(rate, 0, 1e-9);
      for (int i = 0; i < motors; ++i)
        CHECK_NEAR(state.torque[i], settings.kp[i] * state.error[i], 1e-6);
    };
    pushes_alone(still);  // the first cycle, in motion
    state = {};
    still.rate = {};
    pushes_alone(still);
    pushes_alone(away);
    CHECK(std::fabs(state.error[0]) > 1e-5);
    pushes_alone(away);
  }
}

TEST_EACH(for_each, "a desired rate too large for a double fails its own cycle and no later one") {
  Prior prior(robot);
  Extended q_e = readings_at(robot, robot.home);
  for (const Law law : kLaws) {
    ControlSettings settings = settings_for(robot, law);
    settings.feed_forward = FeedForward::none;
    Setpoint setpoint;
    setpoint.x = robot.home;
    for (const double much : {1e160, 1e308})
      for (const bool started : {false, true}) {
        ControlState state;
        setpoint.rate = {};
        if (started) CHECK(control(robot, settings, setpoint, q_e, state, prior.weighing()));
        setpoint.rate.fill(much);
        const ControlState before = state;
        if (!control(robot, settings, setpoint, q_e, state, prior.weighing()))
          CHECK(state.position == before.position && state.torque == before.torque);
        setpoint.rate = {};
        CHECK(control(robot, settings, setpoint, q_e, state, prior.weighing()));
      }
  }
}

TEST_EACH(for_each,
          "shaped by the inertia, an error is answered alike at every pose and by no other motor") {
  Robot robot = mechanism.robot;
  for (Chain& chain : robot.chain) chain.coulomb = chain.viscous = chain.torque_limit = 0;  // none
  check::Random random(88);
  ControlSettings settings = settings_for(robot, Law::joint, Gains::inertia);
  settings.ki.fill(3000);
  for (int k = 0; k < 20; ++k) {
    settings.feed_forward = k % 2 ? FeedForward::full : FeedForward::gravity;
    Setpoint setpoint;
    setpoint.x = any_x(random);
    for (int i = 0; i < n && k % 2; ++i) {
      setpoint.rate[i] = 0.3 * random();
      setpoint.acceleration[i] = random();
    }
    const Pose pose = to_pose(K, setpoint.x);
    Extended q_e = readings_at(robot, pose);
    Joint asked{};
    for (int i = 0; i < motors; ++i) {
      const double error = 1e-3 * random();
      q_e[i] -= error;
      asked[i] = (settings.kp[i] + settings.ki[i] * settings.period) * error;
    }
    ControlState state;
    CHECK(control(robot, settings, setpoint, q_e, state));
    Coordinates acceleration{};
    CHECK(forward_dynamics(robot, pose, setpoint.rate, state.torque, acceleration));
    JointMatrix J;
    CHECK(jacobian(Level::ideal, robot, setpoint.x, J));
    for (int i = 0; i < n; ++i) {
      double expected = setpoint.acceleration[i];
      for (int j = 0; j < motors; ++j) expected += J[i][j] * asked[j];
      CHECK_NEAR(acceleration[i], expected, 1e-8);
    }
    CHECK_NEAR(settings.kp[0], 1e4, 0);
    CHECK_NEAR(settings.kd[n - 1], 200, 0);
  }
}

TEST_EACH(for_each, "pole placement makes each motor alone a critically damped second order") {
  const ControlSettings settings = settings_for(robot, Law::joint);
  Closure closure;
  Jacobians jacobians;
  DynamicModel model;
  CHECK(ikm(robot, to_pose(K, robot.home), closure));
  CHECK(jacobian(closure, jacobians));
  CHECK(dynamic_model(robot, closure, Coordinates{}, model));
  for (int m = 0; m < motors; ++m) {
    Coordinates column{};  // ẍ of a unit of q̈_m; the torque of motor m for it is its inertia
    for (int i = 0; i < n; ++i) column[i] = jacobians.J[i][m];
    const Joint still = inverse_dynamics(model, jacobians.J, Coordinates{});
    const Joint torque = inverse_dynamics(model, jacobians.J, column);
    const double inertia = torque[m] - still[m];
    CHECK_NEAR(settings.kp[m] / inertia, 1e4, 1e-6);
    CHECK_NEAR(settings.kd[m] / inertia, 200, 1e-8);
  }
}

TEST_EACH(for_each_overdriven,
          "where a redundant motor is at its torque limit the others make up for the force") {
  Robot robot = mechanism.robot;
  const ControlSettings settings = settings_for(robot, Law::joint, Gains::inertia);
  Setpoint setpoint{robot.home, {}, {0.5, -0.4}};
  const Extended q_e = readings_at(robot, robot.home);
  ControlState free, limited;
  CHECK(control(robot, settings, setpoint, q_e, free));
  int most = 0;
  for (int i = 0; i < motors; ++i)
    if (std::fabs(free.torque[i]) > std::fabs(free.torque[most])) most = i;
  const double limit = robot.chain[most].torque_limit = 0.7 * std::fabs(free.torque[most]);
  CHECK(control(robot, settings, setpoint, q_e, limited));
  CHECK_NEAR(std::fabs(limited.torque[most]), limit, 1e-12);
  Coordinates with{}, without{};
  const Pose pose = to_pose(K, robot.home);
  CHECK(forward_dynamics(robot, pose, {}, free.torque, without));
  CHECK(forward_dynamics(robot, pose, {}, limited.torque, with));
  for (int j = 0; j < n; ++j) CHECK_NEAR(with[j], without[j], 1e-9);
  for (Chain& chain : robot.chain) chain.torque_limit = 1e-3;  // all: no more than that
  CHECK(control(robot, settings, setpoint, q_e, limited));
  for (int i = 0; i < motors; ++i) CHECK(std::fabs(limited.torque[i]) <= 1e-3);
}
