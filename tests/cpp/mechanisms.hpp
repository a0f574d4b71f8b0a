// Robots of the tests. One of every kind, none more symmetric than a real one.
//
// The H4 is the paper's, with the project's assumed dimensions and masses (robots/h4). The others
// are plausible machines, their symmetry spoilt by a few millimetres so that no term can cancel
// by chance. All are without friction and with two sensors defined, the first one in use.
#pragma once

#include <functional>
#include <numbers>

#include "check.hpp"
#include "control/law.hpp"
#include "estimation/online_calibrator.hpp"
#include "mechanism/levels.hpp"

namespace mechanisms {

using namespace truepose;

/// Every law that the table has.
inline constexpr auto kLaws = [] {
  std::array<Law, kLawTable.size()> laws{};
  for (std::size_t k = 0; k < laws.size(); ++k) laws[k] = kLawTable[k].law;
  return laws;
}();

struct Mechanism {
  const char* name;
  Robot robot;
  Coordinates box{};  ///< half widths of a box around home, all inside the workspace
};

inline double degrees(double angle) { return angle * std::numbers::pi / 180; }
Vec3 polar(double radius, double angle, double z = 0);

/// Plausible knowledge of a robot, every σ of its own size: all lengths and angles of the chains
/// that the ideal level sees, and the sensors' offsets. Owns the memory that it lends.
class Prior {
 public:
  explicit Prior(const Robot& robot);
  Prior(const Prior&) = delete;
  Prior& operator=(const Prior&) = delete;
  Knowledge& known() { return known_; }
  Weighing weighing() { return {&known_, work_.data()}; }
  /// What starts from here and learns; one at a time.
  OnlineCalibrator learner(const Robot& robot);
  /// The same, following changes: of each parameter by itself, fifty of its σ.
  OnlineCalibrator follower(const Robot& robot);

 private:
  std::vector<int> column_;
  std::vector<double> root_, work_, filter_, drift_, step_, odds_, memory_;
  std::vector<std::int32_t> end_;
  Window window_;
  Knowledge known_;
};

/// A telemeter along a line through `origin`, towards a plane of the nacelle.
Sensor telemeter(const Vec3& origin, const Vec3& direction, const Vec3& target, const Vec3& normal);

void add_body(Robot& robot, double mass, const Vec3& pivot, const Vec3& anchor = Vec3::Zero(),
              const Vec3& inertia = Vec3::Zero());

void set_masses(Chain& chain, double drive, double arm, double rod);

/// Makes the chain a spatial parallelogram, drawn as its axis stands now.
void set_pair(Chain& chain, int bar = -1);

Mechanism h4();

Mechanism five_bar();

Mechanism planar(const char* name, Actuator actuator, int motors = 3);

/// A 3-RPR of similar triangles: wherever θ is 0 its legs meet in one point, a singularity of
/// type 2.
Robot meeting_legs();

Mechanism delta();

Mechanism linear_delta();

Mechanism par4();

/// Six chains between neighbouring points of two hexagons: 6-UPS and 6-RUS.
Mechanism hexapod(const char* name, Actuator actuator);

/// Six carriages on three pairs of horizontal rails along x.
Mechanism hexaglide();

/// Four arms and rods in a plane: one motor more than freedoms.
Mechanism four_rrr();

/// A platform on eight taut cables: two motors more than freedoms.
Mechanism eight_cables();

/// Calls f(mechanism) for each of a list.
void for_all(const std::vector<Mechanism>& list, const std::function<void(const Mechanism&)>& f);
/// Calls f(mechanism) for each that no passive axes carry (theirs: rotational.hpp).
void for_each(const std::function<void(const Mechanism&)>& f);
/// The same for those with as many motors as freedoms.
void for_each_square(const std::function<void(const Mechanism&)>& f);
/// The same for those with more.
void for_each_overdriven(const std::function<void(const Mechanism&)>& f);
/// Calls f(mechanism, level) for each at its levels.
void for_each_model(const std::function<void(const Mechanism&, Level)>& f);

/// A random pose of the box, shrunk by `part`.
Coordinates random_pose(const Mechanism& mechanism, check::Random& random, double part = 1);

/// What a statement about each robot is about: its body has these.
struct Subject {
  const Mechanism& mechanism;
  Level level = Level::ideal;
  const Robot& robot = mechanism.robot;
  Mobility K = robot.mobility;
  int n = dof(K), motors = robot.motors;

  Coordinates any_x(check::Random& random, double part = 1) const {
    return random_pose(mechanism, random, part);
  }
  Pose any_pose(check::Random& random, double part = 1) const {
    return to_pose(K, any_x(random, part));
  }
};

/// A statement about each robot of a list (for_each, for_each_pivot…), of for_each_model at each of
/// its levels. Its body is a function of a Subject.
#define TEST_EACH(list, statement)                                    \
  namespace {                                                         \
  struct CHECK_JOIN(Each, __LINE__) : Subject {                       \
    void holds() const;                                               \
  };                                                                  \
  }                                                                   \
  TEST(statement) {                                                   \
    list([](const Mechanism& mechanism, Level level = Level::ideal) { \
      CHECK_JOIN(Each, __LINE__){{mechanism, level}}.holds();         \
    });                                                               \
  }                                                                   \
  void CHECK_JOIN(Each, __LINE__)::holds() const

/// x moved by `size` metres and radians in every freedom, up or down.
Pose nearby(Mobility K, const Pose& pose, check::Random& random, double size);

/// What a robot reads at a pose.
Extended readings_at(const Robot& robot, const Pose& pose);
Extended readings_at(const Robot& robot, const Coordinates& x);

/// Numbers of the motors or of the platform's freedoms.
struct RandomNumbers {
  Coordinates values{};
  operator Coordinates() const { return values; }
  operator Joint() const;
};
RandomNumbers random_joint(check::Random& random, double size);

/// Largest entry of the difference of two poses.
double distance(Mobility K, const Pose& a, const Pose& b);

}  // namespace mechanisms
