// Does the controller do what it should: rest, track, hold its torque when it must not trust?
#include <limits>
#include <numbers>

#include "mechanisms.hpp"
#include "truepose/offline/simulate.hpp"
#include "truepose/offline/statics.hpp"

using namespace mechanisms;

namespace {

ControlSettings settings_for(const Robot& robot, Law law, Gains gains = Gains::diagonal) {
  ControlSettings settings;
  settings.law = law;
  settings.gains = gains;
  CHECK(place_poles(robot, robot.home, 100, 1, settings));
  return settings;
}

/// The robot as built: some rods and arms longer or shorter than drawn.
template <Mobility K>
Robot built(const Robot& nominal, check::Random& random) {
  Robot truth = nominal;
  for (int i = 0; i < kDof<K>; ++i) {
    truth.chain[i].rod += 1e-3 * random();
    truth.chain[i].arm += 3e-4 * random();
    truth.chain[i].encoder_offset += 1e-3 * random();
  }
  return truth;
}

}  // namespace

TEST("an ideal robot at rest stays at rest, under every law") {
  for_each([](const Mechanism& mechanism, auto mobility) {
    constexpr Mobility K = mobility();
    const Robot& robot = mechanism.robot;
    for (const Law law : kLaws) {
      if (!applies(law, K)) continue;
      const ControlSettings settings = settings_for(robot, law);
      const Run run{robot.home, robot.home, 0.05, 0.05, 2};
      double strayed = 0;
      const Pose home = to_pose<K>(robot.home);
      Prior prior(robot);
      CHECK(simulate<K>(
          robot, robot, settings, run, robot.home,
          [&](const Sample& sample) {
            strayed = std::max(strayed, distance<K>(to_pose<K>(sample.x), home));
          },
          Extras{prior.weighing()}));
      CHECK_NEAR(strayed, 0, 1e-12);
    }
  });
}

TEST("an ideal robot follows a move with full feed-forward, and ends on the spot") {
  for_each([](const Mechanism& mechanism, auto mobility) {
    constexpr Mobility K = mobility();
    const Robot& robot = mechanism.robot;
    check::Random random(61);
    const Joint to = random_pose(mechanism, random);
    for (const Law law : kLaws) {
      if (!applies(law, K)) continue;
      const Run run{robot.home, to, 0.3, 0.2, 2};
      double strayed = 0;
      Sample last{};
      Prior prior(robot);
      CHECK(simulate<K>(
          robot, robot, settings_for(robot, law), run, robot.home,
          [&](const Sample& sample) {
            strayed = std::max(strayed, distance<K>(to_pose<K>(sample.x), to_pose<K>(sample.x_d)));
            last = sample;
          },
          Extras{prior.weighing()}));
      CHECK_NEAR(strayed, 0, 2e-3);  // torques are held for 1 ms
      CHECK_NEAR(distance<K>(to_pose<K>(last.x), to_pose<K>(to)), 0, 1e-6);
    }
  });
}

TEST("whatever fails, the last torque is held, nothing else changes, and the status says why") {
  for_each([](const Mechanism& mechanism, auto mobility) {
    constexpr Mobility K = mobility();
    constexpr int n = kDof<K>;
    const Robot& robot = mechanism.robot;
    for (const Law law : kLaws) {
      if (!applies(law, K)) continue;
      ControlSettings settings = settings_for(robot, law);
      settings.ki.fill(1);
      Prior prior(robot);
      const Weighing weighing = prior.weighing();
      Setpoint at_home;
      at_home.x = robot.home;
      Extended q_e{};
      CHECK(extended<K>(robot, to_pose<K>(robot.home), q_e));
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
      for (const double bad : {std::numeric_limits<double>::quiet_NaN(), HUGE_VAL, -HUGE_VAL}) {
        for (int c = 0; c < (law == Law::joint ? n : n + robot.r); ++c) {  // that it uses
          Extended broken = q_e;
          broken[c] = bad;
          check_held(control(robot, settings, at_home, broken, state, weighing),
                     Status::not_finite);
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
      ControlSettings broken = settings;
      broken.kp[0] = std::numeric_limits<double>::quiet_NaN();
      check_held(control(robot, broken, at_home, q_e, state, weighing), Status::not_finite);
      if (!properties(law).weighs) continue;
      check_held(control(robot, settings, at_home, q_e, state), Status::not_measured);
      for (const double sigma : {0.0, -1.0, std::numeric_limits<double>::quiet_NaN()}) {
        prior.known().sigma[0] = sigma;
        check_held(control(robot, settings, at_home, q_e, state, weighing), Status::not_finite);
      }
    }
  });
}

TEST("a singular setpoint holds the torque too") {
  Robot robot = planar("3-RPR", Actuator::telescopic).robot;
  const ControlSettings settings = settings_for(robot, Law::redundant);
  for (int i = 0; i < 3; ++i) {  // the legs meet in one point at θ = 0
    robot.chain[i].base = polar(0.4, 90 + 120 * i);
    robot.chain[i].pivot = polar(0.1, 90 + 120 * i);
  }
  Extended q_e{};
  CHECK(extended<Mobility::planar>(robot, Pose{}, q_e));
  ControlState state;
  state.torque = {1, 2, 3};
  CHECK(control(robot, settings, Setpoint{}, q_e, state).status == Status::singular);
  CHECK(state.torque == (Joint{1, 2, 3}) && !state.started);
}

TEST("a setpoint in another assembly mode is a lost branch and holds the torque") {
  const Robot robot = delta().robot;
  Robot other = robot;
  other.assembly_sign = -robot.assembly_sign;
  const ControlSettings settings = settings_for(robot, Law::joint);
  Setpoint at_home;
  at_home.x = robot.home;
  Extended q_e{};
  CHECK(extended<Mobility::translation>(robot, to_pose<Mobility::translation>(robot.home), q_e));
  ControlState state;
  state.torque = {1, 2, 3};
  CHECK(control(other, settings, at_home, q_e, state).status == Status::branch_lost);
  CHECK(state.torque == (Joint{1, 2, 3}) && !state.started);
}

TEST("a law without its sensor is not measured; joint control needs none") {
  for_each([](const Mechanism& mechanism, auto mobility) {
    constexpr Mobility K = mobility();
    Robot robot = mechanism.robot;
    robot.r = 0;
    Extended q_e{};
    Setpoint at_home;
    at_home.x = robot.home;
    CHECK(extended<K>(robot, to_pose<K>(robot.home), q_e));
    for (const Law law : kLaws) {
      ControlState state;
      Prior prior(robot);
      const Outcome outcome =
          control(robot, settings_for(robot, law), at_home, q_e, state, prior.weighing());
      const bool measured = !properties(law).orientation || K == Mobility::translation;
      CHECK(outcome.status == (measured ? Status::ok : Status::not_measured));
    }
  });
}

TEST("torque limits hold, and a saturated integral does not wind up") {
  const Mechanism mechanism = h4();
  Robot robot = mechanism.robot;
  for (Chain& chain : robot.chain) chain.torque_limit = 3;
  ControlSettings settings = settings_for(robot, Law::joint);
  settings.feed_forward = FeedForward::none;
  settings.kd.fill(0);
  settings.ki.fill(100);
  Setpoint at_home;
  at_home.x = robot.home;
  Extended q_home{}, q_e{};
  CHECK(extended<Mobility::schoenflies>(robot, to_pose<Mobility::schoenflies>(robot.home), q_home));
  for (const double side : {1.0, -1.0}) {
    ControlState state;
    q_e = q_home;
    for (int i = 0; i < 4; ++i) q_e[i] -= 0.5 * side;  // far behind: 0.5 rad
    for (int k = 0; k < 1000; ++k) {
      CHECK(control(robot, settings, at_home, q_e, state));
      for (int i = 0; i < 4; ++i) CHECK_NEAR(state.torque[i], 3 * side, 0);
    }
    for (int i = 0; i < 4; ++i) CHECK_NEAR(state.integral[i], 0, 0);
    for (int i = 0; i < 4; ++i) q_e[i] = q_home[i] + 0.001 * side;  // a little ahead
    CHECK(control(robot, settings, at_home, q_e, state));
    for (int i = 0; i < 4; ++i) CHECK(state.torque[i] * side < 0);  // turns back at once
  }
}

TEST("an integral adds ki times the error's sum where no limit is met") {
  const Robot robot = five_bar().robot;
  ControlSettings settings = settings_for(robot, Law::joint);
  settings.feed_forward = FeedForward::none;
  settings.kp.fill(0);
  settings.kd.fill(0);
  settings.ki.fill(10);
  Setpoint at_home;
  at_home.x = robot.home;
  Extended q_e{};
  CHECK(extended<Mobility::planar_translation>(
      robot, to_pose<Mobility::planar_translation>(robot.home), q_e));
  q_e[0] -= 0.02;
  ControlState state;
  for (int k = 1; k <= 100; ++k) {
    CHECK(control(robot, settings, at_home, q_e, state));
    CHECK_NEAR(state.torque[0], 10 * 0.02 * 1e-3 * k, 1e-12);
    CHECK_NEAR(state.torque[1], 0, 1e-12);
  }
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

TEST("for readings that agree, every law sees the joint error to first order") {
  for_each([](const Mechanism& mechanism, auto mobility) {
    constexpr Mobility K = mobility();
    constexpr int n = kDof<K>;
    Robot robot = mechanism.robot;
    robot.r = 2;
    robot.sensor[1].weight = 16;
    check::Random random(62);
    for (int k = 0; k < 50; ++k) {
      const Joint x = random_pose(mechanism, random), direction = random_joint(random, 1);
      for (const Law law : kLaws) {
        if (!applies(law, K)) continue;
        Prior prior(robot);
        Reference<K> reference;
        CHECK(refer<K>(robot, law, x, reference, 0, prior.weighing()));
        const auto departure = [&](double size) {
          Joint step{}, joint{}, error{};
          Pose estimate;
          for (int i = 0; i < n; ++i) step[i] = size * direction[i];
          Extended q_e{};
          CHECK(extended<K>(robot, moved<K>(reference.closure.pose, step), q_e));
          CHECK(motor_error<K>(robot, Law::joint, reference, q_e, joint, estimate));
          CHECK(motor_error<K>(robot, law, reference, q_e, error, estimate, prior.weighing()));
          double largest = 0;
          for (int i = 0; i < n; ++i) {
            CHECK(std::fabs(joint[i]) < 30 * size);
            largest = std::max(largest, std::fabs(error[i] - joint[i]));
          }
          return largest;
        };
        CHECK_NEAR(departure(1e-4), 0, 3e-6);  // second order: 1e-8 times the curvature
        CHECK(departure(1e-5) < 0.011 * departure(1e-4) + 1e-13);
      }
    }
  });
}

TEST("settle() foretells where the simulation comes to rest, with and without gravity") {
  for_each([](const Mechanism& mechanism, auto mobility) {
    constexpr Mobility K = mobility();
    check::Random random(63);
    for (const bool gravity : {false, true}) {
      Robot nominal = mechanism.robot;
      if (!gravity) nominal.gravity = Vec3::Zero();
      const Robot truth = built<K>(nominal, random);
      const Joint to = random_pose(mechanism, random, 0.5);
      for (const Law law : kLaws) {
        if (!applies(law, K)) continue;
        const Gains gains = law == Law::joint ? Gains::diagonal : Gains::inertia;
        const StaticsSettings settings{settings_for(nominal, law, gains), gravity};
        Joint start{}, end{};
        Prior prior(nominal);
        CHECK(settle<K>(nominal, truth, settings, nominal.home, start, prior.weighing()));
        CHECK(settle<K>(nominal, truth, settings, to, end, prior.weighing()));
        Sample last{};
        CHECK(simulate<K>(
            nominal, truth, settings.control, Run{nominal.home, to, 0.2, 0.6, 2}, start,
            [&](const Sample& sample) { last = sample; }, Extras{prior.weighing()}));
        CHECK_NEAR(distance<K>(to_pose<K>(last.x), to_pose<K>(end)), 0, 1e-9);
        CHECK(distance<K>(to_pose<K>(end), to_pose<K>(to)) > 1e-5);  // the errors do show
      }
    }
  });
}

TEST("an error of one reading leaks into the pose at rest as leakage() says, under every law") {
  for_each([](const Mechanism& mechanism, auto mobility) {
    constexpr Mobility K = mobility();
    constexpr int n = kDof<K>;
    Robot robot = mechanism.robot;
    robot.r = 2;
    check::Random random(64);
    const Joint x = random_pose(mechanism, random);
    Prior prior(robot);
    for (const Law law : kLaws) {
      if (!applies(law, K)) continue;
      ExtendedRows leak;
      CHECK(leakage<K>(robot, law, x, leak, prior.weighing()));
      for (int c = 0; c < n + robot.r; ++c) {
        Pose rest[2];
        for (const double side : {-1.0, 1.0}) {
          Robot read = robot;  // reading = position - offset
          (c < n ? read.chain[c].encoder_offset : read.sensor[c - n].offset) -= side * 1e-5;
          Joint end{};
          CHECK(
              settle<K>(robot, read, {settings_for(robot, law), false}, x, end, prior.weighing()));
          rest[side > 0] = to_pose<K>(end);
        }
        const Joint change = difference<K>(rest[1], rest[0]);
        for (int i = 0; i < n; ++i) CHECK_NEAR(leak[i][c], change[i] / 2e-5, 1e-6);
      }
    }
  });
}

TEST("weights that know nothing of the geometry and trust all readings alike are the paper's") {
  for_each([](const Mechanism& mechanism, auto mobility) {
    constexpr Mobility K = mobility();
    Robot robot = mechanism.robot;
    robot.r = 2;
    check::Random random(65);
    const Joint x = random_pose(mechanism, random);
    Knowledge known;
    known.sigma.fill(0.3);
    std::vector<double> work(estimate_work(robot, 0));
    Reference<K> paper, weighted;
    CHECK(refer<K>(robot, Law::redundant, x, paper));
    CHECK(refer<K>(robot, Law::weighted, x, weighted, 0, {&known, work.data()}));
    for (int i = 0; i < kDof<K>; ++i)
      for (int c = 0; c < kDof<K> + robot.r; ++c)
        CHECK_NEAR(weighted.tej[i][c], paper.tej[i][c], 1e-10);
  });
}

TEST("on the estimate, a hexapod that turns through a right angle is damped by its true twist") {
  constexpr Mobility K = Mobility::spatial;
  const Robot robot = hexapod("6-UPS", Actuator::telescopic).robot;
  Prior prior(robot);
  ControlSettings settings = settings_for(robot, Law::estimated);
  settings.feed_forward = FeedForward::none;
  const Joint twist{0.02, -0.01, 0.03, 0.3, -0.5, 1.0};
  ControlState state;
  Pose pose = moved<K>(to_pose<K>(robot.home), {0, 0, 0, 0.3, 0.2, -0.4});
  Joint step{};
  for (int i = 0; i < 6; ++i) step[i] = twist[i] * settings.period;
  for (int k = 0; k < 600; ++k) {
    Setpoint setpoint{to_coordinates<K>(pose), {}, {}};
    Extended q_e{};
    CHECK(extended<K>(robot, pose, q_e));
    CHECK(control(robot, settings, setpoint, q_e, state, prior.weighing()));
    pose = moved<K>(pose, step);
  }
  for (int i = 0; i < 6; ++i) CHECK_NEAR(state.rate[i], -twist[i], 1e-6);
}

namespace {

/// Largest distance, m, of an ideal H4 from a circle of 50 mm radius that it goes round twice a
/// second, its feed-forward full, its readings exact.
double contouring(const ControlSettings& settings) {
  constexpr Mobility K = Mobility::schoenflies;
  constexpr double kRadius = 0.05, kTurn = 4 * std::numbers::pi;
  const Robot robot = h4().robot;
  const auto circle = [&](int k) {
    const double angle = kTurn * k * settings.period, c = std::cos(angle), s = std::sin(angle);
    const double v = kRadius * kTurn, a = v * kTurn;
    return Setpoint{{kRadius * c, kRadius * s, -0.42, 0}, {-v * s, v * c}, {-a * c, -a * s}};
  };
  Prior prior(robot);
  Loop<K> loop(robot, robot, settings, circle(0).x, 0, Extras{prior.weighing()});
  double largest = 0;
  CHECK(loop.follow(1500, 2, circle, [&](const Sample& sample) {
    const double out = std::hypot(sample.x[0], sample.x[1]) - kRadius;
    const double off = std::hypot(out, sample.x[2] + 0.42);
    if (sample.time > 0.5) largest = std::max(largest, off);  // it started at rest
  }));
  return largest;
}

}  // namespace

TEST("the velocity filter's lag is no tracking error: a circle stays one, under every law") {
  const Robot robot = h4().robot;
  for (const Law law : kLaws) {
    ControlSettings settings = settings_for(robot, law);
    CHECK(place_poles(robot, robot.home, 150, 1, settings));
    CHECK(contouring(settings) < 3e-6);  // 0.12 mm with the lag, 1.8 at the soft gains
    settings.velocity_bandwidth = 300;
    CHECK(place_poles(robot, robot.home, 40, 1, settings));
    CHECK(contouring(settings) < 5e-5);
  }
}

TEST("a setpoint that jumps, and a controller switched on in motion, kick no rate") {
  for_each([](const Mechanism& mechanism, auto mobility) {
    constexpr Mobility K = mobility();
    constexpr int n = kDof<K>;
    const Robot& robot = mechanism.robot;
    check::Random random(87);
    for (const Law law : kLaws) {
      if (!applies(law, K)) continue;
      ControlSettings settings = settings_for(robot, law);
      settings.feed_forward = FeedForward::none;
      Prior prior(robot);
      Setpoint still, away;
      still.x = robot.home;
      Joint step{};
      for (int i = 0; i < n; ++i) {
        step[i] = 1e-3 * random();
        still.rate[i] = 0.1 * random();
      }
      away.x = to_coordinates<K>(moved<K>(to_pose<K>(robot.home), step));
      Extended q_e{};
      CHECK(extended<K>(robot, to_pose<K>(robot.home), q_e));
      ControlState state;
      const auto pushes_alone = [&](const Setpoint& setpoint) {
        CHECK(control(robot, settings, setpoint, q_e, state, prior.weighing()));
        for (const double rate : state.rate) CHECK_NEAR(rate, 0, 1e-9);
        for (int i = 0; i < n; ++i)
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
  });
}

TEST("a desired rate too large for a double fails its own cycle and no later one") {
  for_each([](const Mechanism& mechanism, auto mobility) {
    constexpr Mobility K = mobility();
    const Robot& robot = mechanism.robot;
    Prior prior(robot);
    Extended q_e{};
    CHECK(extended<K>(robot, to_pose<K>(robot.home), q_e));
    for (const Law law : kLaws) {
      if (!applies(law, K)) continue;
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
  });
}

TEST("shaped by the inertia, an error is answered alike at every pose and by no other motor") {
  for_each([](const Mechanism& mechanism, auto mobility) {
    constexpr Mobility K = mobility();
    constexpr int n = kDof<K>;
    Robot robot = mechanism.robot;
    for (Chain& chain : robot.chain)
      chain.coulomb = chain.viscous = chain.torque_limit = 0;  // none
    check::Random random(88);
    ControlSettings settings = settings_for(robot, Law::joint, Gains::inertia);
    settings.ki.fill(3000);
    for (int k = 0; k < 20; ++k) {
      settings.feed_forward = k % 2 ? FeedForward::full : FeedForward::gravity;
      Setpoint setpoint;
      setpoint.x = random_pose(mechanism, random);
      for (int i = 0; i < n && k % 2; ++i) {
        setpoint.rate[i] = 0.3 * random();
        setpoint.acceleration[i] = random();
      }
      Extended q_e{};
      const Pose pose = to_pose<K>(setpoint.x);
      CHECK(extended<K>(robot, pose, q_e));
      Joint asked{};
      for (int i = 0; i < n; ++i) {
        const double error = 1e-3 * random();
        q_e[i] -= error;
        asked[i] = (settings.kp[i] + settings.ki[i] * settings.period) * error;
      }
      ControlState state;
      CHECK(control(robot, settings, setpoint, q_e, state));
      Joint acceleration{};
      CHECK(forward_dynamics<K>(robot, pose, setpoint.rate, state.torque, acceleration));
      JointMatrix J;
      CHECK(jacobian(robot, setpoint.x, J));
      for (int i = 0; i < n; ++i) {
        double expected = setpoint.acceleration[i];
        for (int j = 0; j < n; ++j) expected += J[i][j] * asked[j];
        CHECK_NEAR(acceleration[i], expected, 1e-8);
      }
      CHECK_NEAR(settings.kp[0], 1e4, 0);
      CHECK_NEAR(settings.kd[n - 1], 200, 0);
    }
  });
}

TEST("a robot rests under its weight also where gravity holds it more stiffly than a soft PD") {
  constexpr Mobility K = Mobility::schoenflies;
  const Robot robot = h4().robot;
  check::Random random(89);
  for (const Gains gains : {Gains::diagonal, Gains::inertia}) {
    ControlSettings settings;
    settings.gains = gains;
    CHECK(place_poles(robot, robot.home, 8, 1, settings));
    settings.feed_forward = FeedForward::gravity;
    const Robot truth = built<K>(robot, random);
    Joint x{}, load{};
    CHECK(settle<K>(robot, truth, {settings, true}, robot.home, x));
    Extended q_e{};
    CHECK(extended<K>(truth, to_pose<K>(x), q_e));
    Setpoint at_home;
    at_home.x = robot.home;
    ControlState state;
    CHECK(control(robot, settings, at_home, q_e, state));
    CHECK(inverse_dynamics<K>(truth, to_pose<K>(x), Joint{}, Joint{}, load));
    for (int i = 0; i < 4; ++i) CHECK_NEAR(state.torque[i], load[i], 1e-9);
  }
}

TEST("settle() never calls a NaN settled") {
  const Robot robot = h4().robot;
  for (const Gains gains : {Gains::diagonal, Gains::inertia}) {
    StaticsSettings settings{settings_for(robot, Law::joint, gains), true};
    for (const double gain : {0.0, std::numeric_limits<double>::quiet_NaN()}) {
      settings.control.kp.fill(gain);
      Joint x{};
      CHECK(!settle<Mobility::schoenflies>(robot, robot, settings, robot.home, x));
    }
  }
}

TEST("pole placement makes each motor alone a critically damped second order") {
  for_each([](const Mechanism& mechanism, auto mobility) {
    constexpr Mobility K = mobility();
    const ControlSettings settings = settings_for(mechanism.robot, Law::joint);
    Closure<K> closure;
    Jacobians<K> jacobians;
    DynamicModel<K> model;
    CHECK(ikm<K>(mechanism.robot, to_pose<K>(mechanism.robot.home), closure));
    CHECK(jacobian<K>(closure, jacobians));
    CHECK(dynamic_model<K>(mechanism.robot, closure, Joint{}, model));
    for (int m = 0; m < kDof<K>; ++m) {
      Joint column{};  // ẍ of a unit of q̈_m; the torque of motor m for it is its inertia
      for (int i = 0; i < kDof<K>; ++i) column[i] = jacobians.J[i][m];
      const Joint still = inverse_dynamics<K>(model, jacobians.J, Joint{});
      const Joint torque = inverse_dynamics<K>(model, jacobians.J, column);
      const double inertia = torque[m] - still[m];
      CHECK_NEAR(settings.kp[m] / inertia, 1e4, 1e-6);
      CHECK_NEAR(settings.kd[m] / inertia, 200, 1e-8);
    }
  });
}
