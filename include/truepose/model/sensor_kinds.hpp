// Kinds of sensors, and what holds for every reading of a kind. One row each.
//
// Whoever must know something of a kind asks this table, the Python package included. What a kind
// reads, with its derivatives, is its `sense` (sensors/).
#pragma once

#include <array>
#include <cstddef>
#include <type_traits>

namespace truepose {

enum class Unit : int {
  one = 0,
  metre = 1,
  radian = 2,
  reading = 3,  ///< of a parameter: the unit of its motor or sensor
};

/// What a redundant sensor measures. One sensor is one number; a tracker is several of them.
enum class SensorKind : int {
  platform_angle = 0,  ///< θ of the nacelle about z, gear undone
  plane_distance = 1,  ///< distance along a fixed line to a plane of the nacelle
  coordinate = 2,      ///< a point of the nacelle along a fixed direction (tracker, telemeter)
  distance = 3,        ///< from a point of the base to a point of the nacelle (draw-wire, ball bar)
  inclinometer = 4,    ///< turn of the nacelle about one of its axes, against gravity
  rotation = 5,        ///< a component of the nacelle's rotation vector (tracker)
  rod_in_plane = 6,    ///< rod's direction in its joint's plane (elbow, first U-joint angle)
  rod_lateral = 7,     ///< rod's direction out of that plane
  rod_length = 8,      ///< distance of the rod's ends
  motor_encoder = 9,   ///< a second encoder on a motor's load side
  axis_angle = 10,     ///< of a pivot: how far a passive axis has turned
};

/// Vectors of a sensor's mounting, as bits: those that a robot file gives a kind. A kind's reading
/// depends on them alone; an inclinometer's on the vertical besides, which it keeps as its origin.
enum Mounting : unsigned { kOrigin = 1, kDirection = 2, kTarget = 4, kNormal = 8 };
inline constexpr std::array<const char*, 4> kMountingVectors{"origin", "direction", "target",
                                                             "normal"};

/// What all sensors of a kind have in common.
struct SensorProperties {
  SensorKind kind;
  const char* name;        ///< in robot files
  Unit unit;               ///< of its value
  bool of_chain = false;   ///< sees one chain's motor or rod, not the nacelle alone
  bool shaft = false;      ///< an encoder on a turning shaft: gear, counts a turn, eccentricity
  bool wraps = false;      ///< which whole turn it counts from is nobody's geometry
  bool is_theta = false;   ///< is θ, turns and all: gives a nacelle that turns about z alone its R
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

/// What holds for a kind that exists (parts_exist asks whether it does).
constexpr const SensorProperties& properties(SensorKind kind) {
  return kSensorTable[static_cast<std::size_t>(kind)];
}

/// A kind as a type: its own `sense` is an overload on it.
template <SensorKind kind>
using Is = std::integral_constant<SensorKind, kind>;

/// Whether row k of a table is that of enumerator k.
template <class Table, class Column>
constexpr bool in_order(const Table& table, Column column) {
  for (std::size_t k = 0; k < table.size(); ++k)
    if (static_cast<std::size_t>(table[k].*column) != k) return false;
  return true;
}
static_assert(in_order(kSensorTable, &SensorProperties::kind));

}  // namespace truepose
