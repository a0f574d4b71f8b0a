// Registration of a tracker: its derivatives, and the frames found from measurements.
#include "calibration/registration.hpp"

#include <span>

#include "check.hpp"

using namespace truepose;

namespace {

constexpr Mobility kKinds[]{Mobility::planar_translation, Mobility::planar, Mobility::translation,
                            Mobility::schoenflies, Mobility::spatial};

bool in_plane(Mobility mobility) { return positions_of(mobility) == 2; }
bool turns(Mobility mobility) { return turns_about_z(mobility) || mobility == Mobility::spatial; }

/// Length of the marker's x axis across the tracker's z.
double level_part(const Seen& at) { return std::hypot(at.Q(0, 0), at.Q(1, 0)); }

Pose some_pose(Mobility mobility, check::Random& random) {
  Coordinates step{};
  for (int i = 0; i < dof(mobility); ++i)
    step[i] = (i < positions_of(mobility) ? 0.4 : 0.7) * random();
  return moved(mobility, Pose{}, step);
}

/// Measurements of a marker on a robot at random poses, by a tracker in a frame of its own.
struct Scene {
  Mobility mobility;
  Registration truth;
  int n = dof(mobility);
  std::vector<Pose> pose{};
  std::vector<Status> status{};
  std::vector<double> measured{};

  explicit Scene(Mobility of, int rows = 20) : mobility(of) {
    check::Random random(31);
    // An angle about z is that of a marker of which x is level: tracker and base are both upright.
    const bool tilts = mobility == Mobility::translation || mobility == Mobility::spatial;
    truth.base = {Vec3(0.7, -1.2, in_plane(mobility) ? 0 : 0.3),
                  exp_so3(tilts ? Vec3(0.4, -0.3, 2.1) : Vec3(0, 0, 2.1))};
    if (turns(mobility)) {
      truth.marker.t = Vec3(0.05, -0.04, 0);
      truth.marker.R =
          exp_so3(mobility == Mobility::spatial ? Vec3(0.2, -0.5, 0.3) : Vec3(0, 0, 0.3));
    }
    for (int k = 0; k < rows; ++k) {
      pose.push_back(some_pose(mobility, random));
      status.push_back(Status::ok);
    }
    measure();
  }
  void measure() {
    measured.clear();
    for (const Pose& there : pose) {
      const Seen at = seen(mobility, truth, there);
      const Vec3 turn = log_so3(at.Q);
      for (int i = 0; i < n; ++i)
        measured.push_back(i < positions_of(mobility)      ? at.p[i]
                           : mobility == Mobility::spatial ? turn[i - 3]
                                                           : std::atan2(at.Q(1, 0), at.Q(0, 0)));
    }
  }
  int rows() const { return static_cast<int>(pose.size()); }
  Registration found(bool unknown_marker = true) const {
    Registration known = unknown_marker ? Registration{} : truth;
    known.base = {};
    return registered(mobility, known, true, unknown_marker, unknown_marker, rows(), pose.data(),
                      status.data(), measured.data());
  }
  /// Largest difference of row k's measurement from the expected one.
  double apart(const Registration& by, int k) const {
    const Coordinates e = innovation(mobility, seen(mobility, by, pose[k]), &measured[k * n]);
    double most = 0;
    for (int i = 0; i < n; ++i)
      most = std::max(most, std::isnan(e[i]) ? INFINITY : std::fabs(e[i]));
    return most;
  }
};

}  // namespace

TEST("what a tracker sees changes with pose, frame and marker as its derivatives say") {
  check::Random random(7);
  constexpr double h = 1e-6;
  for (const Mobility mobility : kKinds) {
    const int n = dof(mobility);
    Registration by;
    by.base = {Vec3(0.5, -0.3, 0.2), exp_so3(Vec3(0.3, -0.2, 0.4))};
    by.marker = {Vec3(0.03, -0.02, 0.05), exp_so3(Vec3(0.2, 0.1, -0.3))};
    const Pose pose = some_pose(mobility, random);
    const Seen here = seen(mobility, by, pose);
    // A rotation vector has these derivatives where it is as expected, an angle everywhere.
    std::array<double, kMaxDof> measured{};
    const Vec3 turn = log_so3(here.Q);
    for (int i = 0; i < n; ++i)
      measured[i] = mobility == Mobility::spatial && i >= 3 ? turn[i - 3] : 0.2 + 0.1 * i;
    for (const bool in_arc : {false, true}) {
      const auto apart = [&](const Registration& frames, const Pose& at) {
        Seen expected = seen(mobility, frames, at);
        Coordinates e = innovation(mobility, expected, measured.data());
        const int last = turns_about_z(mobility) ? n - 1 : -1;
        if (in_arc && last >= 0) e[last] *= level_part(expected);
        return e;
      };
      Seen expected = here;
      Coordinates e = innovation(mobility, here, measured.data());
      if (in_arc) in_turns(mobility, by, pose, expected, e);
      for (int i = 0; i < n; ++i) CHECK_NEAR(e[i], apart(by, pose)[i], 1e-12);
      for (int j = 0; j < n + kRegistration; ++j) {
        const auto side = [&](double step) {
          Coordinates of_pose{};
          std::array<double, kRegistration> of_frames{};
          (j < n ? of_pose[j] : of_frames[j - n]) = step;
          return apart(moved(by, of_frames.data()), moved(mobility, pose, of_pose));
        };
        const Coordinates up = side(h), down = side(-h);
        for (int i = 0; i < n; ++i)
          CHECK_NEAR(j < n ? expected.H_x[i][j] : expected.H[i][j - n], (down[i] - up[i]) / (2 * h),
                     1e-8);
      }
    }
    const double level = turns_about_z(mobility) ? level_part(here) : 1;
    CHECK_NEAR(here.blunt * level, 1, 1e-12);
    const Coordinates e = innovation(mobility, here, measured.data());
    for (int i = n; i < kMaxDof; ++i) CHECK(std::isnan(e[i]));
  }
}

TEST("exact measurements lead to the tracker's frame and the marker's place") {
  for (const Mobility mobility : kKinds) {
    Scene scene(mobility);
    scene.status[4] = Status::singular;  // a row without a pose says nothing
    scene.measured[4 * scene.n] += 5;
    const Registration found = scene.found(turns(mobility));
    for (int k = 0; k < scene.rows(); ++k)
      if (k != 4) CHECK(scene.apart(found, k) < 1e-6);
    CHECK((found.base.R - scene.truth.base.R).norm() < 1e-6);
    CHECK((found.base.t - scene.truth.base.t).norm() < 1e-6);
    CHECK((found.marker.t - scene.truth.marker.t).norm() < 1e-6);
    CHECK((found.marker.R - scene.truth.marker.R).norm() < 1e-6);
  }
}

TEST("measurements that are grossly wrong do not move the tracker's frame") {
  for (const Mobility mobility : kKinds) {
    Scene scene(mobility);
    for (const int k : {2, 7, 11}) scene.measured[k * scene.n + k % 2] += 0.5 + 0.1 * k;
    const Registration found = scene.found(turns(mobility));
    for (int k = 0; k < scene.rows(); ++k)
      if (k != 2 && k != 7 && k != 11) CHECK(scene.apart(found, k) < 1e-4);
  }
}

TEST("a registration ends where its weighted squares are level in frame and marker") {
  for (const Mobility mobility : kKinds) {
    Scene scene(mobility);
    check::Random random(5);
    const int positions = positions_of(mobility);
    for (int k = 0; k < scene.rows(); ++k)
      for (int i = 0; i < positions; ++i) scene.measured[k * scene.n + i] += 0.02 * random();
    scene.measured[3 * scene.n] += 0.3;
    const Registration found = scene.found(turns(mobility));
    std::vector<Vec3> off;
    std::vector<double> squares;
    for (int k = 0; k < scene.rows(); ++k) {
      Vec3 to = Vec3::Zero();
      for (int i = 0; i < positions; ++i) to[i] = scene.measured[k * scene.n + i];
      off.push_back(to - seen(mobility, found, scene.pose[k]).p);
      squares.push_back(off.back().squaredNorm());
    }
    const double middle = median(squares);
    Vec3 shift = Vec3::Zero(), turn = Vec3::Zero(), place = Vec3::Zero();
    double size = 0;
    for (int k = 0; k < scene.rows(); ++k) {
      const Vec3 pull = off[k] / (1 + squares[k] / middle);
      const Vec3 lever = seen(mobility, found, scene.pose[k]).p - found.base.t;
      shift += pull;
      turn += lever.cross(pull);
      if (turns(mobility)) place += (found.base.R * scene.pose[k].R).transpose() * pull;
      size += pull.norm();
    }
    CHECK(shift.norm() < 1e-3 * size);
    CHECK(turn.norm() < 1e-3 * size);
    CHECK(place.norm() < 1e-3 * size);
  }
}

TEST("where positions span no plane, tracker and base are parallel and apart by the mean") {
  for (const Mobility mobility : kKinds) {
    Scene scene(mobility, 8);
    for (const bool on_a_line : {true, false}) {
      if (on_a_line) {
        for (int k = 0; k < scene.rows(); ++k) {
          scene.pose[k].D = Vec3(0.1 * k, 0, 0);
          for (int i = 0; i < scene.n; ++i)
            scene.measured[k * scene.n + i] = i == 0 ? 0.2 * k : 0.3;
        }
      } else {  // one coordinate of each row
        for (int k = 0; k < scene.rows(); ++k)
          for (int i = 0; i < scene.n; ++i)
            if (i != k % positions_of(mobility)) scene.measured[k * scene.n + i] = NAN;
      }
      const Registration found = scene.found(false);
      CHECK((found.base.R - Mat3::Identity()).norm() < 1e-12);
      for (int i = 0; i < positions_of(mobility); ++i) {
        double sum = 0, count = 0;
        for (int k = 0; k < scene.rows(); ++k) {
          const Vec3 from = scene.pose[k].D + scene.pose[k].R * scene.truth.marker.t;
          const double to = scene.measured[k * scene.n + i];
          if (!std::isnan(to)) sum += to - from[i], ++count;
        }
        CHECK_NEAR(found.base.t[i], sum / count, 1e-12);
      }
    }
  }
}

TEST("an angle may be measured whole turns away, and half a turn wrong") {
  for (const Mobility mobility : {Mobility::planar, Mobility::schoenflies}) {
    const int last = dof(mobility) - 1;
    const Seen here = seen(mobility, {}, Pose{});
    for (const double apart : {-3.1, 0.2, 3.1})
      for (const int whole : {-2, 0, 1}) {
        std::array<double, 4> measured{};
        measured[last] = apart + 2 * std::numbers::pi * whole;
        CHECK_NEAR(innovation(mobility, here, measured.data())[last], apart, 1e-12);
      }
  }
}

TEST("angles of passive axes are measured as they are, without a frame") {
  for (const Mobility mobility : {Mobility::rotational_2, Mobility::rotational_3}) {
    const int n = dof(mobility);
    Pose pose;
    pose.D = Vec3(0.1, -0.2, 0.3);
    Registration known;
    known.base = {Vec3(0.5, -0.3, 0.2), exp_so3(Vec3(0.3, -0.2, 0.4))};
    const Seen here = seen(mobility, known, pose);
    CHECK(here.blunt == 1);
    const std::array<double, 3> measured{0.4, 0.5, 0.7};
    const Coordinates e = innovation(mobility, here, measured.data());
    for (int i = 0; i < n; ++i) {
      CHECK_NEAR(e[i], measured[i] - pose.D[i], 1e-12);
      for (int j = 0; j < n; ++j) CHECK(here.H_x[i][j] == (i == j));
      for (const double slope : here.H[i]) CHECK(slope == 0);
    }
    const Status status = Status::ok;
    const Registration found =
        registered(mobility, known, true, true, true, 1, &pose, &status, measured.data());
    CHECK((found.base.t - known.base.t).norm() == 0);
    CHECK((found.base.R - known.base.R).norm() == 0);
  }
}

TEST("the nearest rotation is a rotation, and none is nearer, whatever the matrix") {
  check::Random random(3);
  for (int sample = 0; sample < 20; ++sample) {
    Mat3 A;
    for (double& entry : std::span(A.data(), 9)) entry = random();
    if (sample % 2) A.col(2) = A.col(0) - A.col(1);  // points of a plane
    const Mat3 R = nearest_rotation(A);
    CHECK((R * R.transpose() - Mat3::Identity()).norm() < 1e-12);
    CHECK_NEAR(R.col(0).cross(R.col(1)).dot(R.col(2)), 1, 1e-12);
    for (int other = 0; other < 20; ++other) {
      const Mat3 turned = exp_so3(Vec3(random(), random(), random())) * R;
      CHECK((turned.transpose() * A).trace() < (R.transpose() * A).trace());
    }
  }
}

TEST("a marker's angle under a slightly tilted tracker is right to the square of its tilt") {
  constexpr double tilt = 0.02;
  const Mobility mobility = Mobility::schoenflies;
  Scene scene(mobility);
  scene.truth.base.R = exp_so3(Vec3(tilt, 0, 0)) * scene.truth.base.R;
  scene.measure();
  const Registration found = scene.found();
  CHECK((found.base.R - scene.truth.base.R).norm() < 1e-6);
  CHECK((found.marker.R - scene.truth.marker.R).norm() < 4 * tilt * tilt);
}

TEST("where a platform hardly turns, all is explained, and noise does not move the marker") {
  for (const double most : {5e-3, 1e-4}) {
    Scene scene(Mobility::spatial);
    check::Random random(3);
    for (Pose& pose : scene.pose) pose.R = exp_so3(2 * most * Vec3(random(), random(), random()));
    scene.truth.marker.t = Vec3(0.3, -0.4, 0.2);
    scene.measure();
    const bool noisy = most < 1e-3;
    for (int k = 0; k < scene.rows() && noisy; ++k)
      for (int i = 0; i < 3; ++i) scene.measured[k * scene.n + i] += 1e-3 * random();
    const Registration found = scene.found();
    for (int k = 0; k < scene.rows(); ++k) CHECK(scene.apart(found, k) < 2e-3);
    // Noise, which its place would have to explain, does not move it.
    if (noisy) CHECK(found.marker.t.norm() < 0.02);
  }
}
