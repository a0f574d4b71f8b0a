// The members of the structs of truepose.h that are the core's, by name: one table for each.
//
// The core's structs begin with the same members in the same places, which is checked here at
// compile time: the C interface copies them as bytes. By the tables Python reads and writes every
// member, `truepose export c` writes constants in C, and a robot's numbers are checked.
#pragma once

#include <cstddef>
#include <cstring>
#include <span>

#include "c/each.hpp"
#include "control/fault_tolerant_control.hpp"
#include "control/joints.hpp"
#include "estimation/changes.hpp"
#include "estimation/estimate.hpp"
#include "truepose/truepose.h"

namespace truepose::c {
enum class Numbers : int { real, whole, flag, part };  ///< Real, four bytes, bool, a struct

struct Table;

/// A member: a number or a struct, or an array of one or two dimensions.
struct Field {
  const char* name;
  int offset, width;
  Numbers numbers;
  int rows, columns;   ///< 0: not in this dimension
  const Table* table;  ///< of a struct

  constexpr int count() const { return (rows ? rows : 1) * (columns ? columns : 1); }
};

/// A struct's table, the size of the struct in C, and its name in the core.
struct Table {
  std::span<const Field> fields;
  int size;
  const char* name = "";
};

template <class Struct>
struct Described;
template <class Struct>
inline constexpr Table table_of{Described<Struct>::fields, Described<Struct>::size,
                                Described<Struct>::name};

namespace fields_detail {
template <class T>
struct Shape {
  static constexpr int rows = 0, columns = 0;
  using Number = T;
};
template <class T, std::size_t N>
struct Shape<T[N]> : Shape<T> {
  static constexpr int rows = N, columns = Shape<T>::rows;
};
template <class T, std::size_t N>
struct Shape<std::array<T, N>> : Shape<T[N]> {};
template <>
struct Shape<Vec3> : Shape<Real[3]> {};

template <class T>
constexpr Field field(const char* name, std::size_t offset) {
  using S = Shape<T>;
  using Number = typename S::Number;
  Field made{name, int(offset), sizeof(Number), Numbers::whole, S::rows, S::columns, nullptr};
  if constexpr (requires { Described<Number>::fields; })
    made.numbers = Numbers::part, made.table = &table_of<Number>;
  else if constexpr (std::is_same_v<Number, Real>)
    made.numbers = Numbers::real;
  else if constexpr (std::is_same_v<Number, bool>)
    made.numbers = Numbers::flag;
  else
    static_assert(sizeof(Number) == 4);
  return made;
}

/// All members but Eccentricity, which is two of C's: gear and eccentricity.
void numbers(const auto& member)
  requires(!std::is_same_v<std::remove_cvref_t<decltype(member)>, Eccentricity>);

/// Whether the members follow each other, with no room for another one between them, to `end`.
constexpr bool complete(std::span<const Field> fields, std::size_t end) {
  int at = 0;
  for (const Field& field : fields) {
    if (field.offset < at || field.offset - at >= field.width) return false;
    at = field.offset + field.count() * field.width;
  }
  return at == int(end);
}
}  // namespace fields_detail

#define TRUEPOSE_FIELD(C, Core, member) \
  fields_detail::field<decltype(C::member)>(#member, offsetof(C, member)),
// Members that the core names differently are between two that it does not.
#define TRUEPOSE_SAME_PLACE(C, Core, member)                                                       \
  static_assert([]<class T>(T*) {                                                                  \
    if constexpr (requires(T core) { fields_detail::numbers(core.member); })                       \
      return offsetof(T, member) == offsetof(C, member) && sizeof(T::member) == sizeof(C::member); \
    else                                                                                           \
      return true;                                                                                 \
  }(static_cast<Core*>(nullptr)));
// TRUEPOSE_MEMBERS(T, a, b, …): these members of a struct that C does not have.
#define TRUEPOSE_MEMBERS(T, ...) TRUEPOSE_DESCRIBED(T, T, 0, __VA_ARGS__)
#define TRUEPOSE_DESCRIBED(C, Core, bytes, ...)                                              \
  template <>                                                                                \
  struct Described<Core> {                                                                   \
    using type = C;                                                                          \
    static constexpr Field fields[] = {TRUEPOSE_EACH(TRUEPOSE_FIELD, C, Core, __VA_ARGS__)}; \
    static constexpr const char* name = #Core;                                               \
    static constexpr int size = bytes;                                                       \
  };
// TRUEPOSE_TABLE(C, Core, a, b, …): all members of C.
#define TRUEPOSE_TABLE(C, Core, ...)                                              \
  TRUEPOSE_DESCRIBED(C, Core, sizeof(C), __VA_ARGS__)                             \
  template <>                                                                     \
  struct Described<C> : Described<Core> {};                                       \
  static_assert(std::is_trivially_copyable_v<Core> && sizeof(C) <= sizeof(Core)); \
  static_assert(fields_detail::complete(Described<Core>::fields, sizeof(C)));     \
  TRUEPOSE_EACH(TRUEPOSE_SAME_PLACE, C, Core, __VA_ARGS__)

TRUEPOSE_TABLE(truepose_chain, Chain, actuator, working_mode, bar, unused, base, axis, zero, pivot,
               anchor, pair_axis, pair_drawn, arm, rod, rod_spacing, rod_difference, encoder_offset,
               encoder_gain, encoder_buildup, gear, eccentricity, encoder_step, encoder_noise, low,
               high, torque_limit, drive_inertia, arm_mass, rod_mass, viscous, coulomb)
TRUEPOSE_TABLE(truepose_sensor, Sensor, kind, chain, at_nacelle, rod, bar, axis, gain, offset, gear,
               eccentricity, step, noise, weight, origin, direction, target, normal)
TRUEPOSE_TABLE(truepose_body, Body, bar, unused, mass, pivot, anchor, inertia)
TRUEPOSE_TABLE(truepose_axis, PassiveAxis, origin, direction, low, high)
TRUEPOSE_TABLE(truepose_description, Robot, abi, size, mobility, chains, motors, sensors, bodies,
               bar_joint, level, unused, gravity, home, chain, sensor, body, axis)
TRUEPOSE_TABLE(truepose_control_settings, ControlSettings, size, law, gains, feed_forward,
               sigma_scale, unused, period, velocity_bandwidth, damped_below, lead_out, kp, kd, ki)
TRUEPOSE_TABLE(truepose_fault_monitor_settings, FaultMonitorSettings, size, refresh, coast, decide,
               spikes, within, period, false_alarm, replaceable, correlation, stop, stop_lost, held,
               fastest, moved, kp, kd, rests, shaken, low, high)
TRUEPOSE_TABLE(truepose_multirate_settings, MultirateSettings, size, stamped, every, age, period,
               sensitivity)
TRUEPOSE_TABLE(truepose_safety_limits, SafetyLimits, size, window, age, counter_bits, period,
               saturation, clipped, missing, held, stop, brake, standstill, torque, slew, tracking,
               deviation, speed, count, still, kp, kd, rests, low, high, box_low, box_high)
TRUEPOSE_TABLE(truepose_servo_cycle, ServoCycle, q_d, error, J, tej, x)
TRUEPOSE_TABLE(truepose_axis_state, AxisState, position, velocity, torque)
TRUEPOSE_TABLE(truepose_setpoint, Setpoint, x, rate, acceleration)
TRUEPOSE_TABLE(truepose_path_clock, PathClock, time, rate, slowing, since)

static_assert(sizeof(truepose_axis_command) == sizeof(AxisCommand) &&
              sizeof(truepose_estimate_result) == sizeof(Estimate) &&
              sizeof(truepose_fkm_result) == sizeof(FkmResult) &&
              sizeof(truepose_knowledge) == sizeof(Knowledge) &&
              sizeof(truepose_changes) == sizeof(ChangeSettings));

/// A struct of the core as one of truepose.h, or back: its bytes, as many as both have.
template <class To, class From>
To converted(const From& from) {
  static_assert(std::is_trivially_copyable_v<To> && std::is_trivially_copyable_v<From>);
  To to;
  std::memcpy(static_cast<void*>(&to), &from, min(sizeof to, sizeof from));
  return to;
}

/// Writes a robot, finished or nominal, as its description.
void describe(const Robot& robot, truepose_description& description);

/// Whether all numbers of a struct are finite.
bool finite(const void* of, const Table& table);
template <class Core>
bool finite(const Core& of) {
  return finite(&of, table_of<Core>);
}
}  // namespace truepose::c
