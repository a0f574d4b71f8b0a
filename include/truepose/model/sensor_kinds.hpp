// Kinds of sensors and their common properties, one row each.
//
// Single source for all code, Python included. Readings and derivatives are in `sense` (sensors/).
#pragma once

#include <array>
#include <cstddef>
#include <type_traits>

namespace truepose {

enum class Unit : int {
  one = 0,
  metre = 1,
  radian = 2,
  reading = 3,  ///< of a parameter: that of its motor's or sensor's reading
};

/// Quantity that a redundant sensor measures. One sensor is one number; a tracker is several.
enum class SensorKind : int {
  platform_angle = 0,  ///< θ of the platform about z, gear undone
  plane_distance = 1,  ///< distance along a fixed line to a plane of the platform
  coordinate = 2,      ///< a point of the platform along a fixed direction (tracker, telemeter)
  distance = 3,        ///< from a base point to a platform point (draw-wire, ball bar)
  inclinometer = 4,    ///< turn of the platform about one of its axes, relative to gravity
  rotation = 5,        ///< a component of the platform's rotation vector (tracker)
  rod_in_plane = 6,    ///< rod's direction in its joint's plane (elbow, first U-joint angle)
  rod_lateral = 7,     ///< rod's direction out of that plane
  rod_length = 8,      ///< distance of the rod's ends
  motor_encoder = 9,   ///< a second encoder on a motor's load side
  axis_angle = 10,     ///< angle of a passive axis
};

/// Mounting vectors that a robot file gives a kind, as bits. A kind's reading depends on these
/// only; an inclinometer's also on the vertical, stored as its origin.
enum Mounting : unsigned { kOrigin = 1, kDirection = 2, kTarget = 4, kNormal = 8 };
inline constexpr std::array<const char*, 4> kMountingVectors{"origin", "direction", "target",
                                                             "normal"};

/// Properties common to all sensors of a kind.
struct SensorProperties {
  SensorKind kind;
  const char* name;        ///< in robot files
  Unit unit;               ///< of its value
  bool of_chain = false;   ///< measures one chain's motor or rod, not the platform alone
  bool shaft = false;      ///< encoder on a turning shaft: gear, counts per turn, eccentricity
  bool wraps = false;      ///< whole turns are arbitrary
  bool is_theta = false;   ///< θ, turns included: gives R of a platform that turns about z only
  unsigned mounting = 0u;  ///< see Mounting
};

/// In the order of SensorKind.
inline constexpr std::array kSensorTable{
    SensorProperties{.kind = SensorKind::platform_angle,
                     .name = "platform_angle",
                     .unit = Unit::radian,
                     .shaft = true,
                     .is_theta = true},
    SensorProperties{.kind = SensorKind::plane_distance,
                     .name = "plane_distance",
                     .unit = Unit::metre,
                     .mounting = kOrigin | kDirection | kTarget | kNormal},
    SensorProperties{.kind = SensorKind::coordinate,
                     .name = "coordinate",
                     .unit = Unit::metre,
                     .mounting = kOrigin | kDirection | kTarget},
    SensorProperties{.kind = SensorKind::distance,
                     .name = "distance",
                     .unit = Unit::metre,
                     .mounting = kOrigin | kTarget},
    SensorProperties{.kind = SensorKind::inclinometer,
                     .name = "inclinometer",
                     .unit = Unit::radian,
                     .wraps = true,
                     .mounting = kDirection | kNormal},
    SensorProperties{.kind = SensorKind::rotation,
                     .name = "rotation",
                     .unit = Unit::radian,
                     .mounting = kDirection},
    SensorProperties{.kind = SensorKind::rod_in_plane,
                     .name = "rod_in_plane",
                     .unit = Unit::radian,
                     .of_chain = true,
                     .shaft = true,
                     .wraps = true},
    SensorProperties{.kind = SensorKind::rod_lateral,
                     .name = "rod_lateral",
                     .unit = Unit::radian,
                     .of_chain = true,
                     .shaft = true},
    SensorProperties{.kind = SensorKind::rod_length,
                     .name = "rod_length",
                     .unit = Unit::metre,
                     .of_chain = true},
    SensorProperties{.kind = SensorKind::motor_encoder,
                     .name = "motor_encoder",
                     .unit = Unit::radian,
                     .of_chain = true,
                     .shaft = true,
                     .wraps = true},
    SensorProperties{
        .kind = SensorKind::axis_angle, .name = "axis_angle", .unit = Unit::radian, .shaft = true},
};  // the last row
inline constexpr int kSensorKinds = static_cast<int>(kSensorTable.size());

/// Properties of a valid kind (see parts_exist).
constexpr const SensorProperties& properties(SensorKind kind) {
  return kSensorTable[static_cast<std::size_t>(kind)];
}

/// A kind as a type, for the overloads of `sense`.
template <SensorKind kind>
using Is = std::integral_constant<SensorKind, kind>;

/// Whether row k of a table belongs to enumerator k.
template <class Table, class Column>
constexpr bool in_order(const Table& table, Column column) {
  for (std::size_t k = 0; k < table.size(); ++k)
    if (static_cast<std::size_t>(table[k].*column) != k) return false;
  return true;
}
static_assert(in_order(kSensorTable, &SensorProperties::kind));

}  // namespace truepose
