// Robots as plain data: chains, sensors, bodies. One struct serves every mechanism.
//
// One closure equation covers the field's rod-type robots (docs/model.md):
//
//     | B_i(q_i) - A_i(x) | = L_i,      A_i(x) = D + R(x) c_i + a_i
//
// and for a pivot A_i(x) = o_1 + R_1(x_1)(o_2 + R_2(x_2)(o_3 + R_3(x_3) c_i)) (docs/rotational.md).
//
// Units are SI (m, rad, kg, N), frames are the base frame unless said otherwise.
#pragma once

#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <type_traits>

#include "truepose/model/encoder.hpp"
#include "truepose/model/plain.hpp"
#include "truepose/model/sensor_kinds.hpp"
#include "truepose/model/sizes.hpp"
#include "truepose/model/status.hpp"

namespace truepose {

template <int Rows, int Columns>
using Matrix = std::array<std::array<Real, Columns>, Rows>;
using JointMatrix = Matrix<kMaxDof, kMaxMotors>;    ///< J, ẋ = J q̇
using PoseMatrix = Matrix<kMaxDof, kMaxDof>;        ///< of twists by twists: covariances
using PoseRows = Matrix<kMaxReadings, kMaxDof>;     ///< H_x, of readings by the pose
using PoseColumns = Matrix<kMaxDof, kMaxReadings>;  ///< of the pose by readings: gain, leakage
using RowMatrix = Eigen::Matrix<Real, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// Which freedoms the mechanism leaves to the nacelle.
enum class Mobility : int {
  planar_translation = 0,  ///< x, y
  planar = 1,              ///< x, y, θ
  translation = 2,         ///< x, y, z
  schoenflies = 3,         ///< x, y, z, θ about z
  spatial = 4,             ///< x, y, z, rotation vector
  pivot_1 = 5,             ///< the angle of the one passive axis that carries the nacelle
  pivot_2 = 6,             ///< the angles of two, the first at the base
  pivot_3 = 7,             ///< of three
};

// For small machines, the same in every unit of a program (cmake: TRUEPOSE_MOBILITY,
// TRUEPOSE_PIVOTS, TRUEPOSE_IDEAL_ONLY, TRUEPOSE_UNWEIGHED): -DTRUEPOSE_ONLY_MOBILITY=schoenflies,
// or another name of a Mobility, compiles nothing for others, whose robots finish() refuses;
// -DTRUEPOSE_NO_PIVOTS nothing for the three pivots; -DTRUEPOSE_IDEAL_ONLY leaves the full level
// out, -DTRUEPOSE_UNWEIGHED the laws that weigh readings by what is known.

/// Whether anything is compiled for robots of a mobility.
constexpr bool compiled([[maybe_unused]] Mobility mobility) {
#ifdef TRUEPOSE_ONLY_MOBILITY
  return mobility == Mobility::TRUEPOSE_ONLY_MOBILITY;
#elif defined(TRUEPOSE_NO_PIVOTS)
  return mobility <= Mobility::spatial;
#else
  return true;
#endif
}

/// Whether the full level is compiled.
#ifdef TRUEPOSE_IDEAL_ONLY
inline constexpr bool kFullLevel = false;
#else
inline constexpr bool kFullLevel = true;
#endif

/// Whether laws that weigh are compiled.
#ifdef TRUEPOSE_UNWEIGHED
inline constexpr bool kLawsWeigh = false;
#else
inline constexpr bool kLawsWeigh = true;
#endif

/// How motor position q moves the base-side point B of a chain.
enum class Actuator : int {
  revolute = 0,    ///< B = P + l (e cos q + (u×e) sin q)
  prismatic = 1,   ///< B = P + u q
  telescopic = 2,  ///< B = P, L = q
};

/// One chain: motor, arm, rod (a spatial parallelogram counts as one rod).
struct Chain {
  Actuator actuator = Actuator::revolute;
  int working_mode = -1;              ///< sign of the chain's entry of J_q: which root of the IKM
  Plain<Vec3> base = Vec3::Zero();    ///< P, on the motor's axis
  Plain<Vec3> axis = Vec3::UnitY();   ///< u, unit
  Plain<Vec3> zero = Vec3::UnitX();   ///< e, direction of the arm at q = 0, unit, normal to u
  Real arm = 0;                       ///< l = |PB|
  Real rod = 0;                       ///< L = |AB|
  Real encoder_offset = 0;            ///< reading = gain q - offset, q the angle or slide as the
  Real encoder_gain = 1;              ///< encoder's disc or scale has it: eccentricity, pitch
  Real encoder_buildup = 0;           ///< β: a slide is v + β v², v what gain and offset read (1/m)
  bool encoder_errs = false;          ///< any of these; noted by finish, set_parameters
  Plain<Vec3> pivot = Vec3::Zero();   ///< c, turns with the nacelle
  Plain<Vec3> anchor = Vec3::Zero();  ///< a, keeps its orientation
  Real encoder_step = 0;              ///< one count, rad or m (0: unquantized)
  Real encoder_noise = 0;             ///< σ of the reading, rad or m
  Real low = -std::numeric_limits<Real>::infinity();  ///< the motor's stops, rad or m,
  Real high = std::numeric_limits<Real>::infinity();  ///< before the encoder's offset
  Real torque_limit = 0;                              ///< N·m or N (0: none)
  Real drive_inertia = 0;  ///< rotor and arm about the axis (kg·m²), or carriage (kg)
  Real arm_mass = 0;       ///< weighs at the middle of the arm, or on the carriage (kg)
  Real rod_mass = 0;       ///< all rods of the chain, slender (kg)
  Real viscous = 0;        ///< N·m·s/rad or N·s/m at the motor
  Real coulomb = 0;        ///< N·m or N at the motor

  Eccentricity eccentricity;  ///< of a revolute motor's encoder

  int bar = -1;  ///< bar that carries A (0-based; -1: the nacelle itself)

  // What only the full level sees (full.hpp): the two rods of a spatial parallelogram, + and -.
  Real rod_spacing = 0;     ///< s, between the two rods (0: there is one rod)
  Real rod_difference = 0;  ///< δ: the rod on the side of +u has L + δ/2, the other L - δ/2
  Plain<Vec3> pair_axis =
      Vec3::UnitY();  ///< prismatic: from rod - to rod + on the carriage (else: u)
  Plain<Vec3> pair_drawn = Vec3::UnitY();  ///< from rod - to rod + on the bar: without yaw and tilt
};

/// A redundant sensor: reading = gain s(x, q) - offset. What its vectors mean:
///
/// - telemeter: line through origin along direction (base); plane through target with normal
///   (nacelle)
/// - coordinate: point target (nacelle) along direction, 0 at origin (base)
/// - distance: from origin (base) to target (nacelle)
/// - inclinometer: about direction, which way is up at 0: normal (nacelle); the vertical is origin
///   (base), which finish() takes from the robot's gravity
/// - rotation: component along direction (base)
/// - rod_* at the nacelle's side: u is direction, e is normal (in the body that carries A)
struct Sensor {
  SensorKind kind = SensorKind::platform_angle;
  int chain = -1;           ///< whose rod or motor (0-based)
  bool at_nacelle = false;  ///< rod_*: at the joint on the nacelle's side
  int rod = 1;              ///< rod_* at the full level: which of the pair, +1 or -1
  Real gain = 1;
  Real offset = 0;
  Real step = 0;              ///< one count of the reading (0: unquantized)
  Real noise = 0;             ///< σ of the reading
  Eccentricity eccentricity;  ///< of an encoder: platform_angle, rod_in_plane, rod_lateral, motor
  bool encoder_errs = false;  ///< eccentricity; noted by finish, set_parameters
  Real weight = 1;            ///< of its row in the TEJ; the paper's is 1
  Plain<Vec3> origin = Vec3::Zero();
  Plain<Vec3> direction = Vec3::UnitZ();  ///< unit
  Plain<Vec3> target = Vec3::Zero();
  Plain<Vec3> normal = Vec3::UnitZ();  ///< unit
  int bar =
      -1;  ///< platform_angle at the full level: this bar's pivot (0-based; -1: the absolute θ)
  int axis = 0;  ///< axis_angle: of a pivot, which passive axis (0-based)
};

/// A passive axis that carries the nacelle of a pivot: the next axis, or the nacelle, turns about
/// it. At x = 0 all frames are parallel to the base's.
struct PassiveAxis {
  Plain<Vec3> origin = Vec3::Zero();  ///< o, a point of it, from that of the axis before (or base)
  Plain<Vec3> direction = Vec3::UnitY();              ///< d, unit, in the frame of the axis before
  Real low = -std::numeric_limits<Real>::infinity();  ///< how far the joint turns, rad
  Real high = std::numeric_limits<Real>::infinity();
};

/// A rigid body of the nacelle, its centre of mass at D + R pivot + anchor.
struct Body {
  Real mass = 0;
  int bar = -1;  ///< the bar that it is (0-based; -1: the nacelle itself)
  Plain<Vec3> pivot = Vec3::Zero();
  Plain<Vec3> anchor = Vec3::Zero();
  Plain<Mat3> inertia =
      Mat3::Zero();  ///< about the centre of mass, nacelle frame; 0 if it keeps its orientation
};

/// How a nacelle carries its lateral bars: what decides the freedoms of the full level.
enum class BarJoint : int {
  pivots = 0,    ///< each bar turns on a pivot of its own (H4)
  four_bar = 1,  ///< bars and couplers are a planar four-bar: the bars turn together (Par4)
};

/// At which level of the model a robot is understood: one rod a chain, or every rod by itself.
enum class Level : int { ideal = 0, full = 1 };

/// Whether every rod can be solved for by itself (full.hpp).
enum class FullKind : int {
  undescribed = 0,  ///< the robot does not say where its rods are (or finish_full was not called)
  same = 1,         ///< the ideal level already has every rod by itself
  exists = 2,       ///< as many rods as freedoms, independent at home
  overconstrained = 3,  ///< `excess` rods too many: they fit by luck or under stress
  loose = 4,            ///< `excess` freedoms that no rod holds
  elastic = 5,  ///< one rod too many: all stretch, equally stiff, by as little as closes the loops
};

/// What finish_full finds out about the rods of a robot, one by one.
struct FullLevel {
  FullKind kind = FullKind::undescribed;
  int rods = 0, bars = 0;
  int unknowns = 0;  ///< freedoms of the nacelle and its bars, the rods taken away
  int excess = 0;
  int sign = 0;  ///< of the determinant at home: the assembly mode (0: not asked for)

  /// Whether the rods are solved for by themselves, apart from the ideal level.
  constexpr bool own() const { return kind == FullKind::exists || kind == FullKind::elastic; }
};

/// A robot and its sensors. Plain data; constant once finished; shared freely between threads.
/// Fill it, then call finish (jacobian.hpp), again after every change of it: until then everything
/// that is asked of it answers `unfinished`. Only set_parameters may change a finished one.
struct Robot {
  Mobility mobility = Mobility::schoenflies;
  int chains = 0;  ///< today as many as the mobility has freedoms
  int motors = 0;  ///< they drive the first chains; today all
  int r = 0;       ///< redundant sensors in use
  int bodies = 0;
  std::array<Chain, kMaxChains> chain;
  std::array<Sensor, kMaxSensors> sensor;
  std::array<Body, kMaxBodies> body;
  Plain<Vec3> gravity = Vec3(0, 0, -9.81);
  Coordinates home{};     ///< a pose well inside the workspace; default guess of the FKM
  int assembly_sign = 0;  ///< sign of det J_x at home (0: not asked for)
  BarJoint bar_joint = BarJoint::pivots;
  bool finished = false;       ///< whether every count, index and enum was found sound, by finish
  bool limited = true;         ///< whether any motor has stops; filled by finish
  FullLevel full;              ///< filled by finish_full
  Level level = Level::ideal;  ///< at which laws and learners understand it
  std::array<PassiveAxis, kMaxAxes> axis;  ///< of a pivot: the first dof(mobility) of them

  /// Whether they solve for every rod by itself.
  constexpr bool rod_by_rod() const { return kFullLevel && level == Level::full && full.own(); }
};

// Copied byte by byte, laid out as C has it.
static_assert(std::is_trivially_copyable_v<Robot> && std::is_standard_layout_v<Robot>);

inline constexpr int kMobilities = 8;
constexpr int dof(Mobility mobility) {
  constexpr std::array<int, kMobilities> sizes{2, 3, 3, 4, 6, 1, 2, 3};
  return sizes[static_cast<std::size_t>(mobility)];
}

/// Whether passive axes carry the nacelle: x are their angles. (Where pivots are left out, none is
/// one.)
constexpr bool pivots([[maybe_unused]] Mobility mobility) {
#ifdef TRUEPOSE_NO_PIVOTS
  return false;
#else
  return mobility == Mobility::pivot_1 || mobility == Mobility::pivot_2 ||
         mobility == Mobility::pivot_3;
#endif
}
/// How many of them there are.
constexpr int passive_axes(Mobility mobility) { return pivots(mobility) ? dof(mobility) : 0; }

/// How outcomes count parts: chain i as i, then sensors, bodies and axes from these on.
inline constexpr int kSensorPart = kMaxChains, kBodyPart = kSensorPart + kMaxSensors,
                     kAxisPart = kBodyPart + kMaxBodies;

/// Whether every count is within its capacity, every enum one of its values, and every index names
/// a part that the robot has: what all other functions take for granted. finish() asks it.
/// @return no_such_part, and the part that names what is not there; -1: the robot itself
inline Outcome parts_exist(const Robot& robot) {
  const auto missing = [](int part) { return Outcome{Status::no_such_part, part}; };
  const auto below = [](auto index, int count) {
    return static_cast<int>(index) >= 0 && static_cast<int>(index) < count;
  };
  const auto bar = [&](int index) { return index == -1 || below(index, kMaxBars); };
  const auto sign = [](int value) { return value == 1 || value == -1; };
  if (!below(robot.mobility, kMobilities) || !below(robot.chains, kMaxChains + 1) ||
      !below(robot.motors, robot.chains + 1) || !below(robot.r, kMaxSensors + 1) ||
      robot.motors + robot.r > kMaxReadings || !below(robot.bodies, kMaxBodies + 1) ||
      !below(robot.bar_joint, 2) || !below(robot.level, 2))
    return missing(-1);
  for (int i = 0; i < robot.chains; ++i) {
    const Chain& chain = robot.chain[i];
    if (!below(chain.actuator, 3) || !sign(chain.working_mode) || !bar(chain.bar))
      return missing(i);
  }
  for (int k = 0; k < robot.r; ++k) {
    const Sensor& sensor = robot.sensor[k];
    if (!below(sensor.kind, kSensorKinds)) return missing(kSensorPart + k);
    const bool chain =
        properties(sensor.kind).of_chain ? below(sensor.chain, robot.chains) : sensor.chain == -1;
    // Asked also where pivots are left out: that they are is for finish() to say.
    const int axes = robot.mobility < Mobility::pivot_1 ? 0 : dof(robot.mobility);
    const bool axis = sensor.kind != SensorKind::axis_angle || below(sensor.axis, axes);
    if (!chain || !axis || !sign(sensor.rod) || !bar(sensor.bar)) return missing(kSensorPart + k);
  }
  for (int k = 0; k < robot.bodies; ++k)
    if (!bar(robot.body[k].bar)) return missing(kBodyPart + k);
  return {};
}

/// Notes which encoders need more than an offset to be read: every chain of every inverse model
/// asks.
inline void note_encoders(Robot& robot) {
  for (int i = 0; i < robot.chains; ++i)
    robot.chain[i].encoder_errs = robot.chain[i].encoder_gain != 1 ||
                                  robot.chain[i].encoder_buildup != 0 ||
                                  robot.chain[i].eccentricity.any();
  for (int k = 0; k < robot.r; ++k)
    robot.sensor[k].encoder_errs = robot.sensor[k].eccentricity.any();
}

/// Notes which way is up for inclinometers: against gravity, along z where there is none.
inline void note_vertical(Robot& robot) {
  const Vec3 g = robot.gravity();
  for (int k = 0; k < robot.r; ++k)
    if (robot.sensor[k].kind == SensorKind::inclinometer)
      robot.sensor[k].origin = g.norm() > 0 ? Vec3(-g.normalized()) : Vec3(Vec3::UnitZ());
}

/// Calls f with the mobility as a compile-time constant, so that sizes are known in the loops. (One
/// that does not exist or is not compiled, of a robot that is not finished, counts as any: whatever
/// f asks refuses.)
template <class F>
constexpr auto with_mobility([[maybe_unused]] Mobility mobility, F&& f) {
#ifdef TRUEPOSE_ONLY_MOBILITY
  return f(std::integral_constant<Mobility, Mobility::TRUEPOSE_ONLY_MOBILITY>{});
#else
  switch (mobility) {
    case Mobility::planar_translation:
      return f(std::integral_constant<Mobility, Mobility::planar_translation>{});
    case Mobility::planar: return f(std::integral_constant<Mobility, Mobility::planar>{});
    case Mobility::translation: return f(std::integral_constant<Mobility, Mobility::translation>{});
    case Mobility::spatial: return f(std::integral_constant<Mobility, Mobility::spatial>{});
#ifndef TRUEPOSE_NO_PIVOTS
    case Mobility::pivot_1: return f(std::integral_constant<Mobility, Mobility::pivot_1>{});
    case Mobility::pivot_2: return f(std::integral_constant<Mobility, Mobility::pivot_2>{});
    case Mobility::pivot_3: return f(std::integral_constant<Mobility, Mobility::pivot_3>{});
#endif
    default: return f(std::integral_constant<Mobility, Mobility::schoenflies>{});
  }
#endif
}

/// Whether the first `count` values are numbers. 0 times anything else is NaN, which stays in the
/// sum: two instructions a value, where asking each takes four and a branch.
template <class Values>
inline bool all_finite(const Values& values, int count) {
  Real sum = 0;
  for (int i = 0; i < count; ++i) sum += 0 * values[static_cast<std::size_t>(i)];
  return sum == 0;
}

}  // namespace truepose
