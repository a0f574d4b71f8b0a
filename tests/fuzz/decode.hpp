// Bytes as a robot, poses and readings. Whatever plain data can hold, within the
// contract of the structs: counts within their capacities, indexes of chains and bars that exist.
#pragma once

#include <cstdint>
#include <cstring>
#include <limits>
#include <numbers>

#include "../cpp/mechanisms.hpp"
#include "promise.hpp"

namespace fuzz {

using namespace truepose;

/// Reads an input from front to back; past its end everything is 0.
class Bytes {
 public:
  Bytes(const std::uint8_t* data, std::size_t size) : data_(data), size_(size) {}

  int byte() { return at_ < size_ ? data_[at_++] : 0; }
  int below(int count) { return byte() % count; }
  bool one_in(int count) { return below(count) == 1; }  // not of a 0, the end of the input

  /// In [-1, 1].
  double share() { return ((byte() << 8 | byte()) - 32768) / 32768.0; }

  /// Any double: mostly of a robot's size, sometimes special, huge, tiny or any bits at all.
  double number() {
    constexpr double special[]{0.0,
                               -0.0,
                               1,
                               -1,
                               std::numeric_limits<double>::quiet_NaN(),
                               std::numeric_limits<double>::infinity(),
                               -std::numeric_limits<double>::infinity(),
                               1e-12,
                               std::numbers::pi,
                               1e160,
                               std::numeric_limits<double>::max(),
                               std::numeric_limits<double>::min(),
                               std::numeric_limits<double>::denorm_min()};
    switch (below(8)) {
      case 1: return special[below(std::size(special))];
      case 2: return share() * std::pow(10, 20 * share());
      case 3: {
        std::uint64_t bits = 0;
        for (int i = 0; i < 8; ++i) bits = bits << 8 | static_cast<std::uint64_t>(byte());
        double value;
        std::memcpy(&value, &bits, sizeof value);
        return value;
      }
      case 4: return 1000 * share();
      default: return share();
    }
  }
  Vec3 vector() {
    const double x = number(), y = number(), z = number();
    return {x, y, z};
  }
  Vec3 unit() {
    const Vec3 any = vector();
    return one_in(8) ? any : any.normalized();  // not unit is against the contract, not the types
  }

 private:
  const std::uint8_t* data_;
  std::size_t size_, at_ = 0;
};

inline void decode_sensor(Bytes& bytes, int chains, Sensor& sensor) {
  sensor.kind = static_cast<SensorKind>(bytes.below(kSensorKinds));
  sensor.chain = properties(sensor.kind).of_chain ? bytes.below(chains) : -1;
  sensor.at_nacelle = bytes.one_in(2);
  sensor.bar = properties(sensor.kind).is_theta ? bytes.below(kMaxBars + 1) - 1 : -1;
  sensor.origin = bytes.vector();
  sensor.direction = bytes.unit();
  sensor.target = bytes.vector();
  sensor.normal = bytes.unit();
  if (!bytes.one_in(4)) return;
  sensor.gain = bytes.number();
  sensor.offset = bytes.number();
  sensor.step = bytes.number();
  sensor.weight = bytes.number();
}

/// Another value for one field of a chain.
inline void spoil(Bytes& bytes, Chain& chain) {
  switch (bytes.below(17)) {
    case 0: chain.base = bytes.vector(); break;
    case 1: chain.axis = bytes.unit(); break;
    case 2: chain.zero = bytes.unit(); break;
    case 3: chain.arm = bytes.number(); break;
    case 4: chain.rod = bytes.number(); break;
    case 5: chain.encoder_offset = bytes.number(); break;
    case 6: chain.pivot = bytes.vector(); break;
    case 7: chain.anchor = bytes.vector(); break;
    case 8: chain.rod_spacing = bytes.number(); break;
    case 9: chain.rod_difference = bytes.number(); break;
    case 10: chain.pair_axis = chain.pair_drawn = bytes.unit(); break;
    case 11: chain.bar = bytes.below(kMaxBars + 1) - 1; break;
    case 12: chain.working_mode *= -1; break;
    case 13: chain.actuator = static_cast<Actuator>(bytes.below(3)); break;
    case 14: chain.torque_limit = bytes.number(); break;
    case 15:
      chain.encoder_gain = bytes.number();
      chain.encoder_buildup = bytes.number();
      break;
    default:
      chain.drive_inertia = bytes.number();
      chain.arm_mass = bytes.number();
      chain.rod_mass = bytes.number();
      chain.viscous = bytes.number();
      chain.coulomb = bytes.number();
  }
}

/// A robot, and whether it is one that could be built: its answers must then be right, not only
/// finite.
struct Subject {
  Robot robot;
  Coordinates box{};
  bool buildable = true;
};

inline Subject decode_robot(Bytes& bytes) {
  static const std::vector<mechanisms::Mechanism> all = [] {
    std::vector<mechanisms::Mechanism> list;
    mechanisms::for_each([&](const mechanisms::Mechanism& one) { list.push_back(one); });
    return list;
  }();
  const mechanisms::Mechanism& drawn = all[bytes.below(static_cast<int>(all.size()))];
  Subject subject{drawn.robot, drawn.box};
  Robot& robot = subject.robot;
  const int m = robot.motors;
  for (int i = 0; i < m; ++i) {  // built a few per cent off
    Chain& chain = robot.chain[i];
    for (double* length : {&chain.arm, &chain.rod}) *length *= 1 + 0.1 * bytes.share();
    chain.base += 0.05 * Vec3(bytes.share(), bytes.share(), 0);
    chain.rod_difference = 1e-3 * bytes.share();
  }
  if (bytes.one_in(3)) {
    subject.buildable = false;
    for (int k = 1 + bytes.below(6); k > 0; --k) spoil(bytes, robot.chain[bytes.below(m)]);
    if (bytes.one_in(4)) robot.gravity = bytes.vector();
    if (bytes.one_in(4)) robot.home[bytes.below(dof(robot.mobility))] = bytes.number();
    if (bytes.one_in(4)) robot.body[0].mass = bytes.number();
    if (bytes.one_in(4)) robot.bar_joint = static_cast<BarJoint>(bytes.below(2));
  }
  if (bytes.one_in(2)) {
    robot.r = bytes.below(std::min(kMaxSensors, kMaxReadings - m) + 1);
    for (int k = 0; k < robot.r; ++k) decode_sensor(bytes, m, robot.sensor[k]);
  }
  if (bytes.one_in(16)) {  // parts that do not exist: refused, and then used by nobody
    Robot broken = robot;
    const int wrong = kMaxReadings + 1 + bytes.byte() * 0x7fffff;  // beyond every capacity and enum
    switch (bytes.below(6)) {
      case 0: broken.chain[bytes.below(m)].bar = wrong; break;
      case 1: broken.chains = wrong; break;
      case 2: broken.r = wrong; break;
      case 3: broken.mobility = static_cast<Mobility>(-wrong); break;
      case 4: broken.chain[bytes.below(m)].actuator = static_cast<Actuator>(wrong); break;
      default: broken.motors = -wrong; break;
    }
    require(finish(broken).status == Status::no_such_part, "finish: a count or index is looked at");
    Joint q{};
    require(ikm(Level::ideal, broken, robot.home, q).status == Status::unfinished,
            "what was refused answers");
  }
  static_cast<void>(finish(robot));
  static_cast<void>(finish_full(robot));
  return subject;
}

/// In the workspace, beside it, far away, or no number at all.
inline Coordinates decode_pose(Bytes& bytes, const Subject& subject) {
  Coordinates x = subject.robot.home;
  const int kind = bytes.below(4);
  for (int i = 0; i < dof(subject.robot.mobility); ++i) {
    if (kind == 3)
      x[i] = bytes.number();
    else
      x[i] += (kind == 2 ? 6 : 1) * subject.box[i] * bytes.share();
  }
  return x;
}

/// Motor positions: those of a pose, or any.
inline Joint decode_motors(Bytes& bytes, const Subject& subject) {
  Joint q{};
  const bool of_pose =
      !bytes.one_in(3) && ikm(Level::ideal, subject.robot, decode_pose(bytes, subject), q);
  if (of_pose && !bytes.one_in(4)) return q;
  for (int i = 0; i < subject.robot.motors; ++i)
    q[i] = of_pose ? q[i] + 0.1 * bytes.share() : bytes.number();
  return q;
}

template <class Rows>
bool finite(const Rows& rows, int count, int width) {
  for (int i = 0; i < count; ++i)
    if (!all_finite(rows[i], width)) return false;
  return true;
}

}  // namespace fuzz
