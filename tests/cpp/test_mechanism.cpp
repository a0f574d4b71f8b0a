// The engine: robots and mechanisms as bodies on joints with closures.
#include <Eigen/Dense>

#include "described.hpp"
#include "estimation/linearise.hpp"
#include "mechanism/sense_mechanism.hpp"
#include "rotational.hpp"

using namespace pivots_tested;
using namespace mechanisms_described;

namespace {

using engine::Body;
using engine::Flaw;
using engine::Kind;
using engine::Position;

/// y with a freedom moved, that of a ball by a small turn.
engine::Row moved(const engine::Mechanism& m, engine::Row y, int freedom, double step) {
  for (int b = 0; b < m.bodies; ++b) {
    const int first = m.body[b].freedom;
    if (m.body[b].kind != Kind::ball || freedom < first || freedom >= first + 3) continue;
    const Vec3 w = log_so3(exp_so3(step * Vec3::Unit(freedom - first)) *
                           exp_so3(Vec3(y[first], y[first + 1], y[first + 2])));
    for (int k = 0; k < 3; ++k) y[first + k] = w[k];
    return y;
  }
  y[freedom] += step;
  return y;
}

/// Largest error of any closure's row against central differences.
double row_error(const engine::Mechanism& m, const engine::Row& y) {
  constexpr double h = 1e-5;
  double worst = 0;
  for (int j = 0; j < m.freedoms; ++j) {
    Position at, up, down;
    at.y = y, up.y = moved(m, y, j, h), down.y = moved(m, y, j, -h);
    for (Position* one : {&at, &up, &down}) engine::place(m, *one);
    for (int i = 0; i < m.closures; ++i)
      worst =
          std::max(worst, std::fabs(engine::row(m, at, i)[j] - (up.f[i] - down.f[i]) / (2 * h)));
  }
  return worst;
}

/// A robot's description, which stands where its own models read q_e.
struct Standing {
  Built built;
  Position at;
  Standing(const Robot& robot, const Pose& pose, const Extended& q_e) {
    build(robot, Layout::ideal, built);
    at.y = stand(robot, built, motors_of(robot, q_e), pose);
    engine::place(built.mechanism, at);
  }
};

double condition(const Robot& robot, const JointMatrix& J) {
  const int n = dof(robot.mobility);
  Eigen::MatrixXd dense(n, robot.motors);
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < robot.motors; ++j) dense(i, j) = J[i][j];
  const Eigen::VectorXd sizes = Eigen::JacobiSVD<Eigen::MatrixXd>(dense).singularValues();
  return std::max(1.0, sizes(0) / sizes(n - 1));
}

}  // namespace

TEST_EACH(for_every,
          "a robot's description gives the q, x and J of its own models, 1000 poses each") {
  check::Random random(131);
  double q_apart = 0, x_apart = 0, J_apart = 0, slope = 0;
  long lost = 0;
  for (long k = 0; k < check::sample_size(1000); ++k) {
    const Pose pose = to_pose(K, any_x(random, reach(K)));
    const Coordinates x = to_coordinates(K, pose);
    Joint q{}, start{};
    JointMatrix J;
    if (!ikm(Level::ideal, robot, x, q) || !jacobian(Level::ideal, robot, x, J)) continue;
    const double unit = condition(robot, J);
    for (int i = 0; i < motors; ++i) start[i] = q[i] + 1e-3 * random();
    Built built;
    build(robot, Layout::ideal, built);
    const engine::Mechanism& m = built.mechanism;
    Position at, back;
    at.y = stand(robot, built, start, pose);
    back.y = stand(robot, built, q, nearby(K, pose, random, 1e-3));
    if (!engine::close(m, at, engine::inverse(m)) || !engine::close(m, back, engine::forward(m)))
      ++lost;
    for (int i = 0; i < motors; ++i)
      q_apart = std::max(q_apart, std::fabs(motor_reading(robot.chain[i], at.y[i]) - q[i]) / unit);
    Coordinates found{};
    std::copy_n(back.y.begin() + motors, n, found.begin());
    x_apart = std::max(x_apart, distance(K, to_pose(K, found), pose) / unit);
    Matrix<kMaxUnknowns, kMaxUnknowns> rates;
    CHECK(engine::follow(m, at, engine::forward(m), engine::motors(m), rates));
    // The closures of redundant motors weigh the engine's least squares, the readings those of J.
    for (int i = 0; i < n && motors == n; ++i)
      for (int j = 0; j < n; ++j) {
        const Chain& chain = robot.chain[j];
        const double rate = 1 / encode(chain, at.y[j]).slope;
        J_apart = std::max(J_apart, std::fabs(rates[i][j] * rate - J[i][j]) /
                                        (unit * std::max(1.0, std::fabs(J[i][j]))));
      }
    if (k < 20) slope = std::max(slope, row_error(m, at.y));
  }
  CHECK(lost == 0);
  CHECK_NEAR(q_apart, 0, 1e-11);
  CHECK_NEAR(x_apart, 0, 1e-11);
  CHECK_NEAR(J_apart, 0, 1e-11);
  CHECK_NEAR(slope, 0, 1e-9);
}

TEST_EACH(for_every, "conditioning of a description is that of the robot's own models") {
  const Robot& robot = mechanism.robot;
  for (int i = 0; i < motors; ++i)
    if (turns_about_z(K) && (robot.chain[i].bar >= 0 || robot.chain[i].anchor.squaredNorm() > 0))
      return;  // a bar that turns back counts in the engine's size of θ, not in the chains'
  check::Random random(132);
  for (int k = 0; k < 100; ++k) {
    const Pose pose = to_pose(K, random_pose(mechanism, random, reach(K)));
    Closure closure;
    if (!ikm(robot, pose, closure)) continue;
    const Conditioning own(closure);
    Built built;
    build(robot, Layout::ideal, built);
    Position at;
    at.y = stand(robot, built, closure.q(), pose);
    engine::place(built.mechanism, at);
    CHECK_NEAR(engine::parallel(built.mechanism, at), own.parallel(), 1e-11);
    for (int i = 0; i < motors; ++i)
      if (robot.chain[i].actuator != Actuator::telescopic)
        CHECK_NEAR(std::fabs(engine::serial(built.mechanism, at, i)), own.serial(i), 1e-11);
  }
}

TEST_EACH(for_every, "readings and H_x of a description are those of the robot's own models") {
  check::Random random(133);
  double apart = 0;
  for (int k = 0; k < 100; ++k) {
    const Pose pose = to_pose(K, any_x(random, reach(K)));
    Extended q_e;
    PoseRows H_x, by_engine;
    if (!linearise(Level::ideal, robot, pose, q_e, H_x, nullptr)) continue;
    const auto [built, at] = Standing(robot, pose, q_e);
    Extended same;
    CHECK(linearise(robot, built, at, pose.theta, same, by_engine, nullptr));
    for (int e = 0; e < readings(robot); ++e) apart = std::max(apart, std::fabs(q_e[e] - same[e]));
    for (int e = 0; e < readings(robot); ++e)
      for (int j = 0; j < n; ++j)
        apart =
            std::max(apart, std::fabs(H_x[e][j] - by_engine[e][j]) / (1 + std::fabs(H_x[e][j])));
  }
  CHECK_NEAR(apart, 0, 1e-11);
}

TEST_EACH(for_every,
          "a parameter changes a sensor's deviation from g times the motors' as H_ξ says") {
  check::Random random(134);
  const int width = parameter_count(robot), m = robot.motors;
  std::vector<double> H(readings(robot) * width), P_H(robot.r * width);
  for (int sample = 0; sample < 10; ++sample) {
    const Pose pose = to_pose(K, any_x(random, reach(K)));
    Extended q_e;
    PoseRows H_x;
    if (!linearise(Level::ideal, robot, pose, q_e, H_x, nullptr)) continue;
    const auto [built, at] = Standing(robot, pose, q_e);
    PredictionRows g;
    for (int k = 0; k < robot.r; ++k)
      for (int i = 0; i < m; ++i) g[k][i] = random();
    CHECK(linearise(robot, built, at, pose.theta, q_e, H_x, H.data()));
    CHECK(linearise(robot, built, at, pose.theta, q_e, H_x, P_H.data(), &g));
    for (int k = 0; k < robot.r; ++k)
      for (int c = 0; c < width; ++c) {
        double deviation = H[(m + k) * width + c];
        for (int i = 0; i < m; ++i) deviation -= g[k][i] * H[i * width + c];
        CHECK_NEAR(P_H[k * width + c], deviation, 1e-9 * (1 + std::fabs(deviation)));
      }
  }
}

TEST("3-RPS, 3-PRS, planar 4-RRR and two balls close at every pose, there and back") {
  for (const Described& one : described()) {
    check::state().scene = one.name;
    const engine::Mechanism& m = one.mechanism;
    Position at;
    at.y = one.home;
    CHECK(engine::check(m, at));
    check::Random random(135);
    double gap = 0, apart = 0, slope = 0, product = 0;
    long lost = 0;
    for (long k = 0; k < check::sample_size(1000); ++k) {
      Position at, back;
      at.y = one.home;
      for (int j = 0; j < m.freedoms; ++j) at.y[j] += one.box[j] * random();
      if (!engine::close(m, at, engine::inverse(m))) ++lost;
      back.y = one.home;
      std::copy_n(at.y.begin(), m.motors, back.y.begin());
      if (!engine::close(m, back, engine::forward(m))) ++lost;
      gap = std::max({gap, at.residual, back.residual});
      for (int j = 0; j < m.freedoms; ++j) apart = std::max(apart, std::fabs(at.y[j] - back.y[j]));
      if (k >= 20) continue;
      CHECK((engine::mode_of(m, at) == 0) == (m.motors > m.coordinates));
      slope = std::max(slope, row_error(m, at.y));
      // J and its inverse are followed separately: J ∂q/∂x = 1.
      engine::Freedoms x;
      x.add(m.motors, m.motors + m.coordinates);
      Matrix<kMaxUnknowns, kMaxUnknowns> J, inverse;
      CHECK(engine::follow(m, at, engine::forward(m), engine::motors(m), J));
      CHECK(engine::follow(m, at, engine::inverse(m), x, inverse));
      for (int i = 0; i < m.coordinates; ++i)
        for (int j = 0; j < m.coordinates; ++j) {
          double sum = -(i == j);
          for (int l = 0; l < m.motors; ++l) sum += J[i][l] * inverse[l][j];
          product = std::max(product, std::fabs(sum));
        }
    }
    CHECK(lost == 0);
    CHECK_NEAR(gap, 0, 1e-14);
    CHECK_NEAR(apart, 0, 1e-11);
    CHECK_NEAR(slope, 0, 1e-9);
    CHECK_NEAR(product, 0, 1e-10);
  }
}

TEST("coupled bars share a freedom by their ratios and offsets") {
  engine::Mechanism m;
  m.bodies = 2, m.motors = 1, m.freedoms = 1;
  m.body[0] = {.freedom = 0, .ratio = 2, .offset = 0.1};
  m.body[1] = {.parent = 0, .freedom = 0, .origin = Vec3::UnitX(), .ratio = -2, .offset = -0.1};
  Position at;
  at.y[0] = 0.3;
  engine::place(m, at);
  CHECK_NEAR(at.frame[1].R(1, 0), 0, 1e-16);  // it keeps its orientation
  CHECK_NEAR(at.frame[1].p.y(), std::sin(0.7), 1e-15);
  CHECK(engine::check_parts(m).flaw == Flaw::none);
  for (int* count : {&m.motors, &m.coordinates})
    for (const int wrong : {-1, 2}) {  // of one freedom
      const int right = std::exchange(*count, wrong);
      CHECK(engine::check_parts(m).flaw == Flaw::no_such_part);
      *count = right;
    }
}

TEST("a bad description is refused with the part that is wrong") {
  const Described good = described()[1];
  const auto flaw_of = [&](auto&& spoil) {
    engine::Mechanism m = good.mechanism;
    spoil(m);
    Position at;
    at.y = good.home;
    return engine::check(m, at);
  };
  const auto is = [](const engine::Check& check, Flaw flaw, int part) {
    return check.flaw == flaw && check.part == part;
  };
  CHECK(is(flaw_of([](auto& m) { m.body[1].parent = 2; }), Flaw::circle, 1));
  CHECK(is(flaw_of([](auto& m) { m.body[2].parent = 99; }), Flaw::no_such_part, 2));
  CHECK(is(flaw_of([](auto& m) { m.closure[3].body_a = -2; }), Flaw::no_such_part,
           engine::kBodies + 3));
  CHECK(is(flaw_of([](auto& m) { m.closures = 40; }), Flaw::too_many_closures, -1));
  CHECK(flaw_of([](auto& m) { m.bodies = 33; }).amount == 33);
  CHECK(is(flaw_of([](auto& m) { m.freedoms = 25; }), Flaw::too_many_freedoms, -1));
  CHECK(is(flaw_of([](auto& m) { m.closure[4].length = 0; }), Flaw::no_length, 4));
  const engine::Check open = flaw_of([](auto& m) { m.closure[2].length = 0.1; });
  CHECK(open.flaw == Flaw::open && open.amount > 0.01);
  CHECK(is(flaw_of([](auto& m) {  // between two points of the base
             m.closure[5] = {.a = {1, 0, 0}, .length = 1};
           }),
           Flaw::unmoved, 5));
  CHECK(is(flaw_of([](auto& m) {  // between two points of the platform
             m.closure[5] = {.body_a = 5, .body_b = 5, .a = {1, 0, 0}, .length = 1};
           }),
           Flaw::unmoved, 5));
  CHECK(is(flaw_of([](auto& m) {  // its carriage carries nothing
             for (int k : {4, 5}) m.closure[k].b = m.body[8].origin, m.closure[k].body_b = -1;
           }),
           Flaw::idle, 2));
  const engine::Check twice = flaw_of([](auto& m) { m.closure[5] = m.closure[3]; });
  CHECK(twice.flaw == Flaw::dependent && (twice.part == 3 || twice.part == 5));
  const engine::Check loose = flaw_of([](auto& m) { --m.closures; });
  CHECK(loose.flaw == Flaw::loose && loose.amount == 1);
}
