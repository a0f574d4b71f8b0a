// The core's structs in memory from C callers, after a marker word.
#pragma once

#include <cstdint>
#include <cstring>
#include <new>

#include "control/command.hpp"
#include "control/fault_tolerant_control.hpp"
#include "control/joints.hpp"
#include "control/safe_control.hpp"
#include "control/start_test.hpp"
#include "estimation/estimate.hpp"
#include "estimation/online_calibrator.hpp"
#include "mechanism/fkm.hpp"
#include "mechanism/full_linearise.hpp"
#include "mechanism/geometry.hpp"
#include "truepose/truepose.h"

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

inline truepose_outcome answer(Outcome outcome) {
  return {static_cast<std::int32_t>(outcome.status), outcome.chain};
}

/// f(robot) of a loaded model, else `otherwise`.
template <class Answer, class F>
Answer of_robot(const truepose_model* model, Answer otherwise, F&& f) {
  const Model* made = Model::of(model);
  return made != nullptr && made->robot.finished ? f(made->robot) : otherwise;
}
template <class F>
truepose_outcome asked(const truepose_model* model, F&& f) {
  return answer(of_robot(model, Outcome{Status::unfinished, -1}, f));
}

/// Outcome of torques at the joints in a build for small machines, whose caller has J.
inline constexpr Outcome kNotRotational{Status::not_compiled, -1};

/// Copies a C array to the core's array.
template <class Values>
Values values(const truepose_real* from) {
  Values result{};
  std::copy_n(from, result.size(), result.begin());
  return result;
}
template <class Values>
void give(const Values& from, truepose_real* to) {
  std::copy_n(from.begin(), from.size(), to);
}
template <std::size_t Rows, std::size_t Columns>
void give(const std::array<std::array<Real, Columns>, Rows>& from, truepose_real* to) {
  for (const auto& row : from) to = std::copy(row.begin(), row.end(), to);
}

/// Checks count and columns of a knowledge. @return no_such_part, and the invalid column's number
inline Outcome columns_exist(const Robot& robot, const truepose_knowledge& known, int least) {
  const int all = parameter_count(robot);
  if (known.count < least || known.count > all) return {Status::no_such_part, -1};
  for (int k = 0; k < known.count; ++k)
    if (known.column[k] < 0 || known.column[k] >= all) return {Status::no_such_part, k};
  return {};
}

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
    knowledge = {known->count, known->column, known->root, values<Extended>(known->sigma)};
    weighing = {&knowledge, work, kept};
  }
  Known(const Known&) = delete;
  Known& operator=(const Known&) = delete;
};
}  // namespace truepose::c
