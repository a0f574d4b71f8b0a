// What is measured: the tests' H4, 6-UPS and ankle at a thousand random poses, so that no branch
// predictor learns the answers. Seeded: every run does the same work.
#pragma once

#include "../tests/cpp/rotational.hpp"
#include "truepose/control/control.hpp"
#include "truepose/kinematics/fkm.hpp"

namespace inputs {

using namespace truepose;

inline constexpr int kPoses = 1000;

template <Mobility K>
struct Inputs {
  Robot robot;
  std::vector<Coordinates> x, near;  ///< poses, guesses 1 mm and 1 mrad away (pivots: 10 mrad)
  std::vector<Joint> q;              ///< their motors
  std::vector<Mat3> R;
  std::vector<Setpoint> setpoint;
  std::vector<Extended> q_e;  ///< readings of the robot a little off its setpoint

  explicit Inputs(const mechanisms::Mechanism& mechanism)
      : robot(mechanism.robot),
        x(kPoses),
        near(kPoses),
        q(kPoses),
        R(kPoses),
        setpoint(kPoses),
        q_e(kPoses) {
    check::Random random(1);
    for (int i = 0; i < kPoses; ++i) {
      x[i] = mechanisms::random_pose(mechanism, random);
      // An ankle's cranks cannot follow to every corner.
      while (kRotational<K> && !ikm(robot, x[i], q[i]))
        x[i] = mechanisms::random_pose(mechanism, random);
      const Pose pose = to_pose<K>(x[i]);
      R[i] = pose.R;
      near[i] =
          to_coordinates<K>(mechanisms::nearby<K>(pose, random, kRotational<K> ? 1e-2 : 1e-3));
      setpoint[i].x = x[i];
      setpoint[i].rate = mechanisms::random_joint(random, 0.5);
      setpoint[i].acceleration = mechanisms::random_joint(random, 5);
      if (!ikm(robot, x[i], q[i]) ||
          !extended<K>(robot, mechanisms::nearby<K>(pose, random, 1e-4), q_e[i]))
        std::printf("pose %d is out of reach\n", i);
    }
  }
};

inline ControlSettings settings_for(const Robot& robot, Law law, FeedForward feed_forward) {
  ControlSettings settings;
  settings.law = law;
  settings.feed_forward = feed_forward;
  if (!place_poles(robot, robot.home, 150, 1, settings)) std::printf("home is singular\n");
  return settings;
}

inline constexpr Law kLaws[]{Law::joint, Law::tej, Law::cartesian};
inline constexpr Law kWeighing[]{Law::weighted, Law::estimated};
inline constexpr const char* kLawNames[]{"joint", "tej", "cartesian", "weighted", "estimated"};

}  // namespace inputs
