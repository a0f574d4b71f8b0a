// Roll, pitch and yaw of machine controllers: R = Rz(yaw) Ry(pitch) Rx(roll).
#include "math/roll_pitch_yaw.hpp"

namespace truepose {
Mat3 from_roll_pitch_yaw(const RollPitchYaw& angles) {
  const auto turn = [&](int axis) { return exp_so3(angles[std::size_t(axis)] * Vec3::Unit(axis)); };
  return turn(2) * turn(1) * turn(0);
}

RollPitchYaw to_roll_pitch_yaw(const Mat3& R, const RollPitchYaw& near) {
  const auto next_to = [&](RollPitchYaw angles) {
    for (std::size_t k = 0; k < 3; ++k)
      angles[k] += 2 * kPi * std::nearbyint((near[k] - angles[k]) / (2 * kPi));
    return angles;
  };
  const Real level = sqrt(R(0, 0) * R(0, 0) + R(1, 0) * R(1, 0));
  if (level < kUpright) {  // R Rx(roll)ᵀ = Rz(yaw) Ry(pitch)
    const Mat3 turned = R * from_roll_pitch_yaw({near[0], 0, 0}).transpose();
    return next_to(
        {near[0], atan2(-turned(2, 0), turned(2, 2)), atan2(-turned(0, 1), turned(1, 1))});
  }
  const Real roll = atan2(R(2, 1), R(2, 2)), pitch = atan2(-R(2, 0), level),
             yaw = atan2(R(1, 0), R(0, 0));
  const RollPitchYaw one = next_to({roll, pitch, yaw}),
                     other = next_to({roll + kPi, kPi - pitch, yaw + kPi});
  Real difference = 0;
  for (std::size_t k = 0; k < 3; ++k)
    difference += fabs(one[k] - near[k]) - fabs(other[k] - near[k]);
  return difference <= 0 ? one : other;
}
}  // namespace truepose
