// The core's structs in memory from C callers, after a marker word.
#pragma once

#include <cstdint>
#include <new>

#include "c/fields.hpp"
#include "control/command.hpp"
#include "estimation/online_calibrator.hpp"
#include "mechanism/geometry.hpp"

namespace truepose::c {
/// A struct in opaque memory. `mark` differs in memory without a struct.
template <class Opaque, class Itself, std::uint32_t kMark>
struct InMemory {
  std::uint32_t mark = kMark;

  /// @return nullptr if the memory is too small or not aligned
  static Itself* make(Opaque* memory, std::size_t size) {
    static_assert(sizeof(Itself) <= sizeof(Opaque) && alignof(Itself) <= alignof(Opaque));
    static_assert(std::is_trivially_destructible_v<Itself>);
    const bool fits = memory != nullptr && size >= sizeof(Itself) &&
                      reinterpret_cast<std::uintptr_t>(memory) % alignof(Itself) == 0;
    return fits ? new (memory) Itself : nullptr;
  }
  /// @return nullptr if the memory holds no struct
  static Itself* of(Opaque* memory) {
    Itself* itself = std::launder(reinterpret_cast<Itself*>(memory));
    return itself->mark == kMark ? itself : nullptr;
  }
  static const Itself* of(const Opaque* memory) { return of(const_cast<Opaque*>(memory)); }
};

struct Model : InMemory<truepose_model, Model, 0x7452424fU> {
  Robot robot;
};
static_assert(std::is_trivially_copyable_v<Model>);  // C callers copy bytes

/// The robot of a loaded model, else nullptr.
inline const Robot* robot_of(const truepose_model* model) {
  const Model* made = Model::of(model);
  return made != nullptr && made->robot.finished ? &made->robot : nullptr;
}

inline constexpr Outcome kUnfinished{Status::unfinished, -1}, kTooSmall{Status::too_small, -1};

inline truepose_outcome answer(Outcome outcome) { return converted<truepose_outcome>(outcome); }
inline truepose_outcome answer(Status status) { return answer(Outcome{status, -1}); }

/// f(robot) of a loaded model, else `unfinished`.
template <class F>
truepose_outcome asked(const truepose_model* model, F&& f) {
  const Robot* robot = robot_of(model);
  return answer(robot ? Outcome(f(*robot)) : kUnfinished);
}

/// Copies a C array to the core's array, and back.
template <class Values>
Values values(const truepose_real* from) {
  Values result{};
  std::memcpy(result.data(), from, sizeof result);
  return result;
}
void give(const auto& from, truepose_real* to) { std::memcpy(to, from.data(), sizeof from); }

/// Checks count and columns of a knowledge. @return no_such_part, and the invalid column's number
Outcome columns_exist(const Robot& robot, const truepose_knowledge& known, int least);

/// The core's view of a knowledge and work space, empty where missing or not `asked`: the check of
/// its columns takes a third of a plain cycle.
struct Known {
  Knowledge knowledge;
  Weighing weighing;
  Outcome sound;  ///< of columns_exist

  Known(const Robot& robot, const truepose_knowledge* known, truepose_real* work,
        CachedGain* kept = nullptr, bool asked = true) {
    if (!asked || known == nullptr || work == nullptr) return;
    sound = columns_exist(robot, *known, 0);
    knowledge = converted<Knowledge>(*known);
    weighing = {&knowledge, work, kept};
  }
  Known(const Known&) = delete;
  Known& operator=(const Known&) = delete;
};
}  // namespace truepose::c
