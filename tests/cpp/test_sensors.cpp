// Derivatives of the readings at both levels: along the pose, and along every parameter.
#include "derivative.hpp"
#include "estimation/linearise.hpp"
#include "mechanism/geometry.hpp"
#include "mechanisms.hpp"

using namespace mechanisms;

namespace {

/// Whether a kind's reading is there, and moves, on robots of this mobility.
bool fits(SensorKind kind, Mobility mobility) {
  switch (kind) {
    case SensorKind::platform_angle:
      return mobility == Mobility::planar || mobility == Mobility::schoenflies;
    case SensorKind::inclinometer:
    case SensorKind::rotation: return mobility == Mobility::spatial;
    case SensorKind::axis_angle: return is_rotational(mobility);
    case SensorKind::joint_angle:
    case SensorKind::slide_position: return is_mechanism(mobility);
    case SensorKind::rod_lateral:
      return mobility != Mobility::planar && mobility != Mobility::planar_translation;
    default: return true;
  }
}

/// Whether a joint on the nacelle's side reads a kind, too.
bool seen_from_the_nacelle(SensorKind kind) {
  return kind == SensorKind::rod_in_plane || kind == SensorKind::rod_lateral;
}

/// Every sensor that a mechanism can carry, one of each kind and side, none along an axis: a kind
/// that is new in the table, too.
std::vector<Sensor> sensors_of(const Robot& robot, Mobility mobility) {
  std::vector<Sensor> sensors;
  const auto add = [&](SensorKind kind, int chain = -1, bool at_nacelle = false) -> Sensor& {
    Sensor sensor;
    sensor.kind = kind;
    sensor.chain = chain;
    sensor.rod = chain == 0 ? 1 : -1;
    sensor.at_nacelle = at_nacelle;
    sensor.gain = 1.5 - 0.4 * static_cast<double>(sensors.size() % 5);
    sensor.offset = 0.1;
    sensor.origin = Vec3(-0.9, 0.2, 0.1);
    sensor.target = Vec3(0.04, -0.03, 0.02);
    sensor.direction = Vec3(0.9, 0.3, -0.2).normalized();
    sensor.normal = Vec3(0.8, 0.5, 0.3).normalized();
    sensors.push_back(sensor);
    return sensors.back();
  };
  const bool flat = mobility == Mobility::planar || mobility == Mobility::planar_translation;
  for (const SensorProperties& row : kSensorTable) {
    if (!fits(row.kind, mobility)) continue;
    if (!row.of_chain) {
      Sensor& sensor = add(row.kind);
      if (row.kind != SensorKind::inclinometer) continue;
      sensor.direction = Vec3(0.8, 0.6, 0);
      sensor.normal = Vec3(0, 0, 1);
      continue;
    }
    for (const int chain : {0, dof(mobility) - 1}) {
      add(row.kind, chain);
      if (!seen_from_the_nacelle(row.kind)) continue;
      Sensor& joint = add(row.kind, chain, true);
      joint.direction = robot.chain[chain].axis;
      joint.normal = flat ? Vec3::UnitX() : normal_to(robot.chain[chain].axis);
    }
  }
  if (robot.full.bars > 0) add(SensorKind::platform_angle).bar = robot.full.bars - 1;
  return sensors;
}

/// An encoder off its centre, by both harmonics.
void spin(Eccentricity& encoder, double size, double gear) {
  encoder.amplitude = {size, -0.6 * size, 0.3 * size, 0.5 * size};
  encoder.gear = gear;
}

/// Adds h to parameter p of chain i, as a builder would: yaw about z, then tilt about e.
void change(Robot& robot, int i, ChainParameter p, double h) {
  Chain& chain = robot.chain[i];
  const int index = static_cast<int>(p);
  if (p >= ChainParameter::eccentricity_c1 && p <= ChainParameter::eccentricity_s2) {
    const int k = index - static_cast<int>(ChainParameter::eccentricity_c1);
    if (chain.actuator == Actuator::revolute) chain.eccentricity.amplitude[k] += h;
    note_encoders(robot);
    return;
  }
  switch (p) {
    case ChainParameter::arm: chain.arm += h; break;
    case ChainParameter::rod: chain.rod += h; break;
    case ChainParameter::encoder_offset: chain.encoder_offset += h; break;
    case ChainParameter::encoder_gain:
      chain.encoder_gain += h;
      note_encoders(robot);
      break;
    case ChainParameter::encoder_buildup:
      if (chain.actuator != Actuator::revolute) chain.encoder_buildup += h;
      note_encoders(robot);
      break;
    case ChainParameter::yaw: {
      const Mat3 turn = rotation_z(h);
      chain.zero = turn * chain.zero;
      chain.axis = turn * chain.axis;
      chain.pair_axis = turn * chain.pair_axis;
      break;
    }
    case ChainParameter::tilt: {
      const Mat3 turn = exp_so3(h * chain.zero);
      chain.axis = turn * chain.axis;
      chain.pair_axis = turn * chain.pair_axis;
      break;
    }
    case ChainParameter::rod_difference: chain.rod_difference += h; break;
    case ChainParameter::rod_spacing: chain.rod_spacing += h; break;
    default:
      if (p <= ChainParameter::base_z)
        chain.base[index] += h;
      else
        (chain.bar < 0 ? chain.pivot : chain.anchor)[index - 8] += h;
  }
}

void change(Robot& robot, int k, SensorParameter p, double h) {
  Sensor& sensor = robot.sensor[k];
  const int index = static_cast<int>(p) - 2;
  if (p >= SensorParameter::eccentricity_c1) {
    const int which = static_cast<int>(p) - static_cast<int>(SensorParameter::eccentricity_c1);
    if (rotary(sensor)) sensor.eccentricity.amplitude[which] += h;
    note_encoders(robot);
    return;
  }
  if (p == SensorParameter::offset)
    sensor.offset += h;
  else if (p == SensorParameter::gain)
    sensor.gain += h;
  else
    (index < 3   ? sensor.origin
     : index < 6 ? sensor.direction
     : index < 9 ? sensor.target
                 : sensor.normal)[index % 3] += h;
  sensor.direction = sensor.direction.normalized();
  sensor.normal = sensor.normal.normalized();
}

/// What a level of the model says at a pose.
struct Readings {
  Extended q_e{};
  PoseRows H_x{};
  std::vector<double> H_xi;
};
Readings read_at(bool full, const Robot& robot, const Pose& pose) {
  Readings at;
  at.H_xi.resize(readings(robot) * parameter_count(robot));
  CHECK(linearise(full ? Level::full : Level::ideal, robot, pose, at.q_e, at.H_x, at.H_xi.data()));
  return at;
}

/// Calls f at both levels, with each mechanism's axes turned, its pairs unequal, its motors' gains
/// and eccentricities their own (chain 0 has neither), and as many of its sensors as fit.
template <class F>
void for_each_with_sensors(F&& f) {
  for_each([&](const Mechanism& mechanism) {
    Robot robot = mechanism.robot;
    const bool full = robot.full.kind == FullKind::same || robot.full.own();
    for (int i = 0; i < robot.motors; ++i) {
      robot.chain[i].encoder_offset = 0.01 * (i + 1);
      robot.chain[i].encoder_gain = i == 2 ? -0.8 : 1 + 0.1 * i;  // one counts backwards
      if (robot.chain[i].actuator == Actuator::revolute)
        spin(robot.chain[i].eccentricity, 0.01 * i, 1);
      else
        robot.chain[i].encoder_buildup = 0.05 * i;
      if (robot.full.kind != FullKind::exists) continue;
      change(robot, i, ChainParameter::yaw, 0.003 * (i - 1));
      change(robot, i, ChainParameter::tilt, 0.002 * (2 - i));
      change(robot, i, ChainParameter::rod_difference, 2e-5 * (i + 1));
    }
    robot.gravity = Vec3(2, -1, -9);  // of a base that does not stand upright
    std::vector<Sensor> all = sensors_of(robot, robot.mobility);
    for (std::size_t k = 0; k < all.size(); ++k)
      if (rotary(all[k])) spin(all[k].eccentricity, 0.02, k % 2 ? 4 : 1);
    const int most = std::min(kMaxSensors, kMaxReadings - robot.motors);
    for (std::size_t first = 0; first < all.size(); first += most) {
      robot.r = 0;
      for (std::size_t k = first; k < all.size() && robot.r < most; ++k)
        robot.sensor[robot.r++] = all[k];
      CHECK(finish(robot));
      for (int k = 0; k < robot.r; ++k)  // up is against gravity
        if (robot.sensor[k].kind == SensorKind::inclinometer)
          CHECK_NEAR((robot.sensor[k].origin + robot.gravity.normalized()).norm(), 0, 1e-15);
      f(false, mechanism, robot);
      if (full) f(true, mechanism, robot);
    }
  });
}

}  // namespace

TEST("H_x is the derivative of every reading along the free twist, the motors following") {
  for_each_with_sensors([](bool full, const Mechanism& mechanism, const Robot& robot) {
    const Mobility K = mechanism.robot.mobility;
    check::Random random(51);
    for (int sample = 0; sample < 20; ++sample) {
      const Pose pose = to_pose(K, random_pose(mechanism, random));
      const auto at = read_at(full, robot, pose);
      for (int j = 0; j < dof(K); ++j) {
        const Extended slope = derivative([&](double h) {
          Coordinates step{};
          step[j] = h;
          return read_at(full, robot, moved(K, pose, step)).q_e;
        });
        for (int k = 0; k < readings(robot); ++k)
          CHECK_NEAR(at.H_x[k][j], slope[k], 1e-8 * (1 + std::fabs(slope[k])));
      }
    }
  });
}

TEST("an encoder on the tool's pivot reads θ at either level while the axes are exact") {
  Robot robot = h4().robot;
  robot.r = 2;
  for (int bar = 0; bar < 2; ++bar) {
    robot.sensor[bar] = {};
    robot.sensor[bar].bar = bar;
    robot.sensor[bar].gain = 1.5;
    robot.sensor[bar].offset = 0.1;
  }
  CHECK(finish(robot) && finish_full(robot));
  check::Random random(53);
  for (int sample = 0; sample < 20; ++sample) {
    const Pose pose = to_pose(robot.mobility, random_pose(h4(), random));
    for (const bool full : {false, true})
      for (int k = 0; k < 2; ++k)
        CHECK_NEAR(read_at(full, robot, pose).q_e[4 + k], 1.5 * pose.theta - 0.1, 1e-9);
  }
}

TEST("a count is the nearest multiple of the step; a step of 0 rounds nothing") {
  CHECK_NEAR(quantized(0.37, 0.1), 0.4, 1e-15);
  CHECK_NEAR(quantized(-0.37, 0.1), -0.4, 1e-15);
  CHECK_NEAR(quantized(0.37, 0), 0.37, 0);
}

TEST("every reading's derivative along every parameter is that of its finite differences") {
  for_each_with_sensors([](bool full, const Mechanism& mechanism, const Robot& robot) {
    const Mobility K = mechanism.robot.mobility;
    const int n = robot.motors;
    check::Random random(52);
    const int width = parameter_count(robot);
    for (int sample = 0; sample < 5; ++sample) {
      const Pose pose = to_pose(K, random_pose(mechanism, random));
      const auto at = read_at(full, robot, pose);
      const auto compare = [&](int column, const Extended& slope) {
        for (int k = 0; k < readings(robot); ++k)
          CHECK_NEAR(at.H_xi[k * width + column], slope[k], 1e-7);
      };
      const auto varied = [&](auto index, auto parameter) {
        return derivative([&](double h) {
          Robot other = robot;
          change(other, index, parameter, h);
          return read_at(full, other, pose).q_e;
        });
      };
      for (int i = 0; i < n; ++i)
        for (int p = 0; p < kChainParameters; ++p)
          compare(chain_column(i) + p, varied(i, static_cast<ChainParameter>(p)));
      for (int bar = 0; bar < kMaxBars; ++bar)
        compare(bar_column(robot, bar), derivative([&](double h) {
                  Robot other = robot;
                  for (int i = 0; i < n; ++i)
                    if (robot.chain[i].bar == bar)
                      other.chain[i].pivot += h * robot.chain[i].pivot.normalized();
                  return read_at(full, other, pose).q_e;
                }));
      for (int k = 0; k < robot.r; ++k)
        for (int p = 0; p < kSensorParameters; ++p)
          compare(sensor_column(robot, k) + p, varied(k, static_cast<SensorParameter>(p)));
    }
  });
}

TEST("a kind's reading depends on the vectors of its mounting, on each of them, and on no other") {
  for (const SensorProperties& row : kSensorTable) {
    check::state().scene = row.name;
    std::array<bool, 4> moves{};
    for_each_with_sensors([&](bool, const Mechanism& mechanism, const Robot& robot) {
      const Mobility K = mechanism.robot.mobility;
      const auto at = read_at(false, robot, to_pose(K, mechanism.robot.home));
      for (int k = 0; k < robot.r; ++k) {
        if (robot.sensor[k].kind != row.kind || robot.sensor[k].at_nacelle) continue;
        const double* own =
            at.H_xi.data() + (robot.motors + k) * parameter_count(robot) + sensor_column(robot, k);
        const int first = static_cast<int>(SensorParameter::origin_x);
        for (int entry = 0; entry < 12; ++entry)
          if (own[first + entry] != 0) moves[entry / 3] = true;
      }
    });
    const unsigned vertical = row.kind == SensorKind::inclinometer ? kOrigin : 0u;
    for (unsigned vector = 0; vector < 4; ++vector)
      CHECK(moves[vector] == (((row.mounting | vertical) & 1u << vector) != 0));
  }
}

TEST_EACH(for_each, "a robot is what its own parameters make of it") {
  Robot robot = mechanism.robot;
  std::vector<double> xi(parameter_count(robot));
  CHECK(drawn_parameters(robot, xi.data()));
  CHECK(set_parameters(mechanism.robot, xi.data(), robot));
  for (int i = 0; i < motors; ++i) {
    const Chain &same = robot.chain[i], &drawn = mechanism.robot.chain[i];
    CHECK_NEAR((same.pair_axis - drawn.pair_drawn).norm(), 0, 1e-15);
    CHECK_NEAR((same.axis - drawn.axis).norm() + (same.zero - drawn.zero).norm(), 0, 1e-15);
  }
}
