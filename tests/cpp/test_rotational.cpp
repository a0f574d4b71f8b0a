// Rotational platforms. Kinematics, gyroscopes, H_ξ.
#include "estimation/linearise.hpp"
#include "mechanism/angles_of.hpp"
#include "mechanism/fkm.hpp"
#include "mechanism/geometry.hpp"
#include "mechanism/gyro.hpp"
#include "rotational.hpp"

using namespace pivots_tested;

namespace {

/// Fourth-order difference quotient.
template <class F>
double slope_of(F&& f, double h = 1e-4) {
  return (8 * (f(h) - f(-h)) - (f(2 * h) - f(-2 * h))) / (12 * h);
}

}  // namespace

// A few corners of an ankle's box lie beyond its cranks' reach (G1: 3 %): IKM says so.
TEST_EACH(for_each_pivot, "FKM(IKM(x)) = x from neutral over the whole range, none lost") {
  check::Random random(72);
  double worst = 0;
  long lost = 0, beyond = 0;
  const long poses = check::sample_size(20000);
  for (long k = 0; k < poses; ++k) {
    const Coordinates x = any_x(random);
    Joint q;
    if (!ikm(Level::ideal, robot, x, q)) {
      ++beyond;
      continue;
    }
    Pose found;  // x = 0
    lost += !fkm(robot, q, found);
    for (int j = 0; j < n; ++j)
      worst = std::max(worst, std::fabs(to_coordinates(K, found)[j] - x[j]));
  }
  CHECK(beyond < 0.2 * poses);
  CHECK(lost == 0);
  CHECK_NEAR(worst, 0, 1e-12);
}

TEST_EACH(for_each_pivot,
          "open loops are as open as their rods say, after small turns and large ones") {
  check::Random random(74);
  for (int k = 0; k < 200; ++k) {
    std::array<Driven, kMaxChains> driven;
    for (int i = 0; i < n; ++i) driven[i] = driven_point(robot.chain[i], 2 * random());
    Loops from, at;
    from.place(robot, driven, any_pose(random));
    Coordinates motion{};
    for (int j = 0; j < n; ++j) motion[j] = std::pow(10, -3 + 3 * random()) * random();
    at.place(robot, driven, moved(K, from.pose, motion));
    for (int j = 0; j < n; ++j) CHECK_NEAR(at.pose.D[j], from.pose.D[j] + motion[j], 0);

    const Carried carried = carried_frames(robot, at.pose);
    Square jx;
    jx_rows(at, jx);
    double cost = 0;
    for (int i = 0; i < n; ++i) {
      const Chain& chain = robot.chain[i];
      const Vec3 lever = carried.pose.R * chain.pivot;
      const Vec3 v = chain.base + driven[i].p - carried.pose.D - lever;
      CHECK_NEAR(at.f[i], 0.5 * (v.squaredNorm() - chain.rod * chain.rod), 1e-16);
      CHECK_NEAR((at.chain[i].v - v).norm(), 0, 1e-15);
      Coordinates row;
      jx_row(carried, v, lever, row.data());
      for (int j = 0; j < n; ++j) CHECK_NEAR(jx[i][j], row[j], 1e-16);
      cost += at.f[i] * at.f[i];
    }
    CHECK_NEAR(at.cost, cost, 1e-30);
  }
}

TEST_EACH(for_every, "a gyroscope reads how the nacelle turns, in the nacelle's own frame") {
  check::Random random(75);
  for (int k = 0; k < 50; ++k) {
    const Coordinates x = any_x(random);
    const Pose pose = to_pose(K, x);
    const Mat3 R = placed(robot, pose).R;
    GyroRows W{};
    CHECK(gyro(robot, x, W));
    for (int j = 0; j < n; ++j)
      for (int axis = 0; axis < 3; ++axis)
        CHECK_NEAR(W[axis][j], slope_of([&](double h) {
                     Coordinates step{};
                     step[j] = h;
                     const Mat3 after = placed(robot, moved(K, pose, step)).R;
                     return log_so3(R.transpose() * after)[axis];
                   }),
                   1e-10);
  }
  GyroRows unused{};
  CHECK(gyro(robot, Coordinates{NAN, NAN, NAN, NAN, NAN, NAN}, unused).status ==
        (K == Mobility::planar_translation || K == Mobility::translation ? Status::ok
                                                                         : Status::not_finite));
  CHECK(gyro(Robot{}, Coordinates{}, unused).status == Status::unfinished);
}

TEST_EACH(for_each_pivot, "readings change with x and with every parameter as H_x and H_ξ say") {
  const int width = parameter_count(robot), rows = readings(robot);
  check::Random random(74);
  std::vector<double> xi(width), H(rows * width);
  CHECK(drawn_parameters(robot, xi.data()));
  for (int k = 0; k < 10; ++k) {
    const Pose pose = any_pose(random, 0.6);
    Extended q_e{};
    PoseRows H_x;
    CHECK(linearise(Level::ideal, robot, pose, q_e, H_x, H.data()));
    for (int j = 0; j < n; ++j)
      for (int m = 0; m < rows; ++m)
        CHECK_NEAR(H_x[m][j], slope_of([&](double h) {
                     Coordinates step{};
                     step[j] = h;
                     Extended there{};
                     CHECK(extended(Level::ideal, robot, moved(K, pose, step), there));
                     return there[m];
                   }),
                   1e-7 * (1 + std::fabs(H_x[m][j])));
    for (int c = 0; c < width; ++c) {
      const bool arm_winds =
          c < robot.chains * kChainParameters &&
          c % kChainParameters == static_cast<int>(ChainParameter::encoder_buildup);
      if (arm_winds) continue;  // arms do without
      for (int m = 0; m < rows; ++m) {
        const double slope = slope_of(
            [&](double h) {
              std::vector<double> other = xi;
              other[c] += h;
              Robot changed = robot;
              CHECK(set_parameters(robot, other.data(), changed));
              Extended there{};
              CHECK(extended(Level::ideal, changed, pose, there));
              return there[m];
            },
            1e-5);
        CHECK_NEAR(H[m * width + c], slope, 1e-6 * (1 + std::fabs(slope)));
      }
    }
  }
}

TEST("axes that coincide and rods that run through their axis are singular") {
  Robot together = x1_ankle().robot;
  together.axis[1].direction = Vec3::UnitY();
  CHECK(finish(together).status == Status::singular);
  Robot through = lever().robot;  // its rod's end on the axis
  through.chain[0].pivot = 0.03 * through.axis[0].direction;
  through.chain[0].rod = (through.chain[0].base - through.axis[0].origin).norm();
  CHECK(finish(through).status == Status::singular);
}

TEST_EACH(for_each_pivot, "angles are found from the place that the axes carry the nacelle to") {
  check::Random random(78);
  for (int k = 0; k < 500; ++k) {
    const Pose pose = any_pose(random);
    Pose found = to_pose(K, robot.home);
    angles_of(robot, placed(robot, pose), found);
    for (int j = 0; j < n; ++j) CHECK_NEAR(found.D[j], pose.D[j], 1e-12);
  }
}

TEST_EACH(for_each_pivot, "an encoder on a passive axis reads its angle where the nacelle stands") {
  check::Random random(79);
  Robot measured = robot;
  measured.r = n;
  for (int j = 0; j < n; ++j) {
    measured.sensor[j] = {};
    measured.sensor[j].kind = SensorKind::axis_angle;
    measured.sensor[j].axis = j;
    measured.sensor[j].gain = 1.5 - j;
    measured.sensor[j].offset = 0.1;
  }
  CHECK(finish(measured));
  for (int k = 0; k < 20; ++k) {
    const Pose pose = any_pose(random, 0.6);
    Extended q_e{}, standing{};
    CHECK(extended(Level::ideal, measured, pose, q_e));
    Joint q = motors_of(measured, q_e), arm{};
    for (int i = 0; i < motors; ++i) arm[i] = motor_position(measured.chain[i], q[i]);
    const Pose seen = placed(measured, pose);
    CHECK(read_standing(measured, to_full({seen.D, seen.R, 0}), arm, arm, standing));
    for (int i = 0; i < motors; ++i) CHECK_NEAR(standing[i], q[i], 1e-12);
    for (int j = 0; j < n; ++j)
      for (const Extended& read : {q_e, standing})
        CHECK_NEAR(read[motors + j], (1.5 - j) * pose.D[j] - 0.1, 1e-9);
  }
}
