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
  platform_angle = 0,   ///< θ of the platform about z, gear undone
  plane_distance = 1,   ///< distance along a fixed line to a plane of the platform
  coordinate = 2,       ///< a point of the platform along a fixed direction (tracker, telemeter)
  distance = 3,         ///< from a base point to a platform point (draw-wire, ball bar)
  inclinometer = 4,     ///< turn of the platform about one of its axes, relative to gravity
  rotation = 5,         ///< a component of the platform's rotation vector (tracker)
  rod_in_plane = 6,     ///< rod's direction in its joint's plane (elbow, first U-joint angle)
  rod_lateral = 7,      ///< rod's direction out of that plane
  rod_length = 8,       ///< distance of the rod's ends
  motor_encoder = 9,    ///< a second encoder on a motor's load side
  axis_angle = 10,      ///< angle of a passive axis
  joint_angle = 11,     ///< of a mechanism: freedom of a hinge
  slide_position = 12,  ///< of a mechanism: freedom of a slide
};

/// Mounting vectors that a robot file gives a kind, as bits. A kind's reading depends on these
/// only; an inclinometer's also on the vertical, stored as its origin.
enum Mounting : unsigned { kOrigin = 1, kDirection = 2, kTarget = 4, kNormal = 8 };
inline constexpr std::array<const char*, 4> kMountingVectors{"origin", "direction", "target",
                                                             "normal"};

/// Traits of a kind, as bits: see SensorProperties.
enum Trait : unsigned { kOfChain = 1, kShaft = 2, kWraps = 4, kIsTheta = 8 };

/// Properties common to all sensors of a kind.
struct SensorProperties {
  SensorKind kind;
  const char* name;   ///< in robot files
  Unit unit;          ///< of its value
  bool of_chain;      ///< measures one chain's motor or rod, not the platform alone
  bool shaft;         ///< encoder on a turning shaft: gear, counts per turn, eccentricity
  bool wraps;         ///< whole turns are arbitrary
  bool is_theta;      ///< θ, turns included: gives R of a platform that turns about z only
  unsigned mounting;  ///< see Mounting

  constexpr SensorProperties(SensorKind of, const char* text, Unit value, unsigned traits,
                             unsigned vectors = 0)
      : kind(of),
        name(text),
        unit(value),
        of_chain(traits & kOfChain),
        shaft(traits & kShaft),
        wraps(traits & kWraps),
        is_theta(traits & kIsTheta),
        mounting(vectors) {}
};

/// In the order of SensorKind.
inline constexpr auto kSensorTable = std::to_array<SensorProperties>({
    {SensorKind::platform_angle, "platform_angle", Unit::radian, kShaft | kIsTheta},
    {SensorKind::plane_distance, "plane_distance", Unit::metre, 0,
     kOrigin | kDirection | kTarget | kNormal},
    {SensorKind::coordinate, "coordinate", Unit::metre, 0, kOrigin | kDirection | kTarget},
    {SensorKind::distance, "distance", Unit::metre, 0, kOrigin | kTarget},
    {SensorKind::inclinometer, "inclinometer", Unit::radian, kWraps, kDirection | kNormal},
    {SensorKind::rotation, "rotation", Unit::radian, 0, kDirection},
    {SensorKind::rod_in_plane, "rod_in_plane", Unit::radian, kOfChain | kShaft | kWraps},
    {SensorKind::rod_lateral, "rod_lateral", Unit::radian, kOfChain | kShaft},
    {SensorKind::rod_length, "rod_length", Unit::metre, kOfChain},
    {SensorKind::motor_encoder, "motor_encoder", Unit::radian, kOfChain | kShaft | kWraps},
    {SensorKind::axis_angle, "axis_angle", Unit::radian, kShaft},
    {SensorKind::joint_angle, "joint_angle", Unit::radian, kShaft},
    {SensorKind::slide_position, "slide_position", Unit::metre, 0},
});  // the last row
inline constexpr int kSensorKinds = int(kSensorTable.size());

/// Properties of a valid kind (see parts_exist).
constexpr const SensorProperties& properties(SensorKind kind) {
  return kSensorTable[std::size_t(kind)];
}

/// A kind as a type, for the overloads of `sense`.
template <SensorKind kind>
using Is = std::integral_constant<SensorKind, kind>;

/// Whether row k of a table belongs to enumerator k.
template <class Table, class Column>
constexpr bool in_order(const Table& table, Column column) {
  for (std::size_t k = 0; k < table.size(); ++k)
    if (std::size_t(table[k].*column) != k) return false;
  return true;
}

static_assert(in_order(kSensorTable, &SensorProperties::kind));
}  // namespace truepose
