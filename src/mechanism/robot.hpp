// Robots as plain data: chains, sensors, bodies. One struct serves every mechanism.
//
// One closure equation covers the field's rod-type robots (docs/model.md):
//
//     | B_i(q_i) - A_i(x) | = L_i,      A_i(x) = D + R(x) c_i + a_i
//
// on passive axes A_i(x) = o_1 + R_1(x_1)(o_2 + R_2(x_2)(o_3 + R_3(x_3) c_i)) (docs/rotational.md).
//
// Units are SI (m, rad, kg, N); frames are the base frame unless stated otherwise.
#pragma once

#include <cstdint>
#include <limits>
#include <type_traits>

#include "math/vec3.hpp"
#include "mechanism/bodies.hpp"
#include "mechanism/encoder.hpp"
#include "mechanism/sensor_kinds.hpp"
#include "truepose/sizes.hpp"
#include "truepose/status.hpp"

namespace truepose {
template <int Rows, int Columns>
using Matrix = std::array<std::array<Real, Columns>, Rows>;
using JointMatrix = Matrix<kMaxDof, kMaxMotors>;    ///< J, ẋ = J q̇
using PoseMatrix = Matrix<kMaxDof, kMaxDof>;        ///< twists by twists: covariances
using PoseRows = Matrix<kMaxReadings, kMaxDof>;     ///< H_x, readings by pose
using SensorRows = Matrix<kMaxSensors, kMaxDof>;    ///< J_r, sensors by pose
using PoseColumns = Matrix<kMaxDof, kMaxReadings>;  ///< pose by readings: gain, cross-sensitivity

/// The platform's degrees of freedom and coordinates x.
enum class Mobility : int {
  planar_translation = 0,  ///< x, y
  planar = 1,              ///< x, y, θ
  translation = 2,         ///< x, y, z
  schoenflies = 3,         ///< x, y, z, θ about z
  spatial = 4,             ///< x, y, z, rotation vector
  rotational_1 = 5,        ///< the angle of the one passive axis that carries the platform
  rotational_2 = 6,        ///< the angles of two passive axes, the first at the base
  rotational_3 = 7,        ///< the angles of three
  mechanism_1 = 8,         ///< the one coordinate of a mechanism of bodies and closures
  mechanism_2 = 9,         ///< its two
  mechanism_3 = 10,        ///< its three
};

/// How motor position q moves the base-side point B of a chain.
enum class Actuator : int {
  revolute = 0,    ///< B = P + l (e cos q + (u×e) sin q)
  prismatic = 1,   ///< B = P + u q
  telescopic = 2,  ///< B = P, L = q
};

/// One chain: motor, arm, rod (a spatial parallelogram counts as one rod). Laid out, like all parts
/// of a robot and all settings of the control path, as the struct of truepose.h (c/fields.hpp).
struct Chain {
  Actuator actuator = Actuator::revolute;
  int working_mode = -1;       ///< sign of the chain's entry of J_q: selects the IKM's root
  int bar = -1;                ///< bar that carries A (0-based; -1: the platform itself)
  int encoder_errs = false;    ///< its encoder needs more than an offset; set by finish
  Vec3 base = Vec3::Zero();    ///< P, on the motor's axis
  Vec3 axis = Vec3::UnitY();   ///< u, unit
  Vec3 zero = Vec3::UnitX();   ///< e, direction of the arm at q = 0, unit, normal to u
  Vec3 pivot = Vec3::Zero();   ///< c, platform point that turns with the platform
  Vec3 anchor = Vec3::Zero();  ///< a, offset that keeps its orientation
  Vec3 pair_axis =
      Vec3::UnitY();  ///< full, prismatic: from rod - to rod + on the carriage (else: u)
  Vec3 pair_drawn = Vec3::UnitY();  ///< full: from rod - to rod + on the bar, without yaw and tilt
  Real arm = 0;                     ///< l = |PB|
  Real rod = 0;                     ///< L = |AB|
  Real rod_spacing = 0;             ///< full: s, between the rods of a parallelogram (0: one rod)
  Real rod_difference = 0;    ///< δ: the rod on the +u side has length L + δ/2, the other L - δ/2
  Real encoder_offset = 0;    ///< reading = gain q - offset, q the angle or slide on the
  Real encoder_gain = 1;      ///< encoder's disc or scale, which has eccentricity and pitch
  Real encoder_buildup = 0;   ///< β: a slide is v + β v², v from gain and offset (1/m)
  Eccentricity eccentricity;  ///< of a revolute motor's encoder
  Real encoder_step = 0;      ///< one count, rad or m (0: unquantized)
  Real encoder_noise = 0;     ///< σ of the reading, rad or m
  Real low = -std::numeric_limits<Real>::infinity();  ///< the motor's stops, rad or m,
  Real high = std::numeric_limits<Real>::infinity();  ///< without the encoder's offset
  Real torque_limit = 0;                              ///< N·m or N (0: none)
  Real drive_inertia = 0;  ///< rotor and arm about the axis (kg·m²), or carriage (kg)
  Real arm_mass = 0;       ///< its weight acts at the middle of the arm, or on the carriage (kg)
  Real rod_mass = 0;       ///< all rods of the chain, slender (kg)
  Real viscous = 0;        ///< N·m·s/rad or N·s/m at the motor
  Real coulomb = 0;        ///< N·m or N at the motor
};

/// A redundant sensor: reading = gain s(x, q) - offset. Vectors by kind:
///
/// - plane_distance: line through origin along direction (base); plane: target, normal (platform)
/// - coordinate: point target (platform) along direction, 0 at origin (base)
/// - distance: from origin (base) to target (platform)
/// - inclinometer: about direction; normal (platform) points up at 0; origin (base) is the
///   vertical, which finish() derives from the robot's gravity
/// - rotation: component along direction (base)
/// - rod_* at the platform: u is direction, e is normal (in the body that carries A)
struct Sensor {
  SensorKind kind = SensorKind::platform_angle;
  int chain = -1;      ///< chain of its rod or motor (0-based)
  int at_nacelle = 0;  ///< rod_*: 1 at the joint on the platform's side
  int rod = 1;         ///< rod_* at the full level: rod of the pair, +1 or -1
  int bar = -1;  ///< platform_angle at the full level: hinge of this bar (0-based; -1: absolute θ)
  int axis = 0;  ///< axis_angle: passive axis; joint_angle, slide_position: freedom (0-based)
  Real gain = 1;
  Real offset = 0;
  Eccentricity eccentricity;  ///< of an encoder: platform_angle, rod_in_plane, rod_lateral, motor
  Real step = 0;              ///< one count of the reading (0: unquantized)
  Real noise = 0;             ///< σ of the reading
  Real weight = 1;            ///< of its row in the TEJ; 1 in the paper
  Vec3 origin = Vec3::Zero();
  Vec3 direction = Vec3::UnitZ();  ///< unit
  Vec3 target = Vec3::Zero();
  Vec3 normal = Vec3::UnitZ();  ///< unit
};

/// A passive axis; the next one, or the platform, turns about it. At x = 0 all frames are parallel.
struct PassiveAxis {
  Vec3 origin = Vec3::Zero();      ///< o, a point on it, from the preceding axis' o (or base)
  Vec3 direction = Vec3::UnitY();  ///< d, unit, in the preceding axis' frame
  Real low = -std::numeric_limits<Real>::infinity();  ///< limits of the joint, rad
  Real high = std::numeric_limits<Real>::infinity();
};

/// A rigid body of the platform, its centre of mass at D + R pivot + anchor.
struct Body {
  int bar = -1;  ///< the bar it belongs to (0-based; -1: the platform itself)
  int unused = 0;
  Real mass = 0;
  Vec3 pivot = Vec3::Zero();
  Vec3 anchor = Vec3::Zero();
  Mat3 inertia =
      Mat3::Zero();  ///< about the centre of mass, platform frame; 0 if it keeps its orientation
};

/// Joint between platform and lateral bars; determines the freedoms of the full level.
enum class BarJoint : int {
  pivots = 0,    ///< each bar turns on its own hinge (H4)
  four_bar = 1,  ///< bars and couplers form a planar four-bar: the bars turn together (Par4)
};

/// Level of the model: one rod per chain, or every rod individually.
enum class Level : int { ideal = 0, full = 1 };

/// Whether the full level can be solved (full.hpp).
enum class FullKind : int {
  undescribed = 0,  ///< the robot file omits the rods' positions (or finish_full was not called)
  same = 1,         ///< the ideal level already models every rod
  exists = 2,       ///< as many rods as freedoms, independent at home
  overconstrained = 3,  ///< `excess` rods too many: closed only by luck or under stress
  loose = 4,            ///< `excess` freedoms that no rod constrains
  elastic = 5,  ///< one rod too many: all deflect, equally stiff, as little as closes the loops
};

/// Result of finish_full: the robot's individual rods.
struct FullLevel {
  FullKind kind = FullKind::undescribed;
  int rods = 0, bars = 0;
  int unknowns = 0;  ///< freedoms of the platform and its bars without the rods
  int excess = 0;
  int sign = 0;  ///< of the determinant at home: the assembly mode (0: not checked)

  /// Whether the rods have a model of their own, different from the ideal level.
  constexpr bool own() const { return kind == FullKind::exists || kind == FullKind::elastic; }
};

/// A robot and its sensors. Plain data; constant once finished; may be shared between threads. Fill
/// it, then call finish (jacobian.hpp), also after every change; until then all functions return
/// `unfinished`. Only set_parameters may change a finished robot.
struct Robot {
  std::uint32_t abi = TRUEPOSE_ABI, size = sizeof(truepose_description);  ///< of the C interface
  Mobility mobility = Mobility::schoenflies;
  int chains = 0;  ///< at least as many as the mobility has freedoms
  int motors = 0;  ///< m; they drive the first chains; at present all
  int r = 0;       ///< redundant sensors in use
  int bodies = 0;
  BarJoint bar_joint = BarJoint::pivots;
  Level level = Level::ideal;  ///< level of the laws and calibrators
  int unused = 0;
  Vec3 gravity = Vec3(0, 0, -9.81);
  Coordinates home{};  ///< a pose well inside the workspace; default guess of the FKM
  std::array<Chain, kMaxChains> chain;
  std::array<Sensor, kMaxSensors> sensor;
  std::array<Body, kMaxBodies> body;
  std::array<PassiveAxis, kMaxAxes> axis;  ///< the first passive_axes(mobility)

  // Not in truepose_description: derived by finish.
  int assembly_sign = 0;  ///< sign of det J_x at home (0: not checked)
  bool finished = false;  ///< all counts, indices and enums are valid
  bool limited = true;    ///< whether any motor or passive axis has limits
  FullLevel full;         ///< set by finish_full

  /// Bodies and closures in place of chains: mechanism_1 to _3. The chains then are its motors
  /// alone; a sensor's `chain` is a closure, its `bar`, like a Body's, a body (-1: the platform).
  engine::Mechanism mechanism;

  /// Whether they model every rod individually.
  constexpr bool rod_by_rod() const {
    return mobility >= Mobility::mechanism_1 || (level == Level::full && full.own());
  }
};

// Copyable byte by byte, with C layout.
static_assert(std::is_trivially_copyable_v<Robot> && std::is_standard_layout_v<Robot>);

inline constexpr int kMobilities = 11;
/// Number of freedoms. (An unfinished robot's mobility may be invalid; it has any.)
constexpr int dof(Mobility mobility) {
  constexpr std::array<int, kMobilities> sizes{2, 3, 3, 4, 6, 1, 2, 3, 1, 2, 3};
  const auto index = std::size_t(mobility);
  return sizes[index < sizes.size() ? index : 0];
}

/// Number of extended positions, m + r.
inline int readings(const Robot& robot) { return robot.motors + robot.r; }
/// Number of readings more than the pose needs, m + r - n: independent equations about ξ.
inline int redundancy(const Robot& robot) { return readings(robot) - dof(robot.mobility); }

/// Whether there are more motors than freedoms: platform motions determine all motor motions, but
/// not the reverse, and m - n combinations of torques only stress the robot.
inline bool overdriven(const Robot& robot) { return robot.motors > dof(robot.mobility); }

/// Whether passive axes carry the platform: x are their angles.
constexpr bool is_rotational(Mobility mobility) {  // no invalid one is, of a robot to be refused
  return mobility >= Mobility::rotational_1 && mobility <= Mobility::rotational_3;
}

/// Whether bodies and closures describe the robot: x are any freedoms of them.
constexpr bool is_mechanism(Mobility mobility) { return mobility >= Mobility::mechanism_1; }

/// Number of passive axes.
constexpr int passive_axes(Mobility mobility) {
  return is_rotational(mobility) ? dof(mobility) : 0;
}

/// Numbers of parts in outcomes: chain i is i; sensors, bodies and axes start at these.
inline constexpr int kSensorPart = kMaxChains, kBodyPart = kSensorPart + kMaxSensors,
                     kAxisPart = kBodyPart + kMaxBodies;

/// Checks counts, enums and indices, which all other functions assume valid. Called by finish().
/// @return no_such_part, and the part with the invalid index; -1: the robot itself
Outcome parts_exist(const Robot& robot);

/// Marks the encoders that need more than an offset, which every inverse model reads per chain.
void note_encoders(Robot& robot);

/// Sets the inclinometers' vertical: against gravity, along z where there is none.
void note_vertical(Robot& robot);

/// Whether the first `count` values are finite. 0 times a non-finite value is NaN, which stays in
/// the sum: two instructions per value; a test of each takes four and a branch.
template <class Values>
inline bool all_finite(const Values& values, int count) {
  Real sum = 0;
  for (int i : range(count)) sum += 0 * values[std::size_t(i)];
  return sum == 0;
}
}  // namespace truepose
