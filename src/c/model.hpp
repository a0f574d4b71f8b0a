// The core's structs in memory from C callers, after a marker word; C's values as the core's.
#pragma once

#include <cstdint>
#include <new>

#include "c/fields.hpp"
#include "control/command.hpp"
#include "estimation/online_calibrator.hpp"
#include "mechanism/geometry.hpp"

namespace truepose::c {
/// The struct in opaque memory of C; specialised for each.
template <class Opaque>
struct Held;

/// Its base. `mark` differs in memory without a struct.
template <class Opaque, std::uint32_t kMark>
struct InMemory {
  std::uint32_t mark = kMark;

  /// @return nullptr if the memory is too small or not aligned
  static Held<Opaque>* make(Opaque* memory, std::size_t size) {
    using Itself = Held<Opaque>;
    static_assert(sizeof(Itself) <= sizeof(Opaque) && alignof(Itself) <= alignof(Opaque));
    static_assert(std::is_trivially_destructible_v<Itself>);
    const bool fits = memory != nullptr && size >= sizeof(Itself) &&
                      reinterpret_cast<std::uintptr_t>(memory) % alignof(Itself) == 0;
    return fits ? new (memory) Itself : nullptr;
  }
  /// @return nullptr if the memory holds no struct
  static const Held<Opaque>* of(const Opaque* memory) {
    const auto* itself = std::launder(reinterpret_cast<const Held<Opaque>*>(memory));
    return itself->mark == kMark ? itself : nullptr;
  }
  static Held<Opaque>* of(Opaque* memory) {
    return const_cast<Held<Opaque>*>(of(const_cast<const Opaque*>(memory)));
  }
};

template <>
struct Held<truepose_model> : InMemory<truepose_model, 0x7452424fU> {
  Robot robot;
};
using Model = Held<truepose_model>;
static_assert(std::is_trivially_copyable_v<Model>);  // C callers copy bytes

/// What a memory holds, of a model the loaded robot, else nullptr.
template <class Opaque>
auto* held(Opaque* memory) {
  auto* made = Held<std::remove_const_t<Opaque>>::of(memory);
  if constexpr (requires { made->robot; })
    return made && made->robot.finished ? &made->robot : nullptr;
  else
    return made;
}

inline constexpr Outcome kUnfinished{Status::unfinished}, kTooSmall{Status::too_small};

inline auto answer(const Outcome& of) { return converted<truepose_outcome>(of); }
inline auto answer(Status of) { return answer(Outcome{of}); }
inline auto answer(const FkmResult& of) { return converted<truepose_fkm_result>(of); }
inline auto answer(const Estimate& of) { return converted<truepose_estimate_result>(of); }

/// with(memory, …)(f): f(what each holds), or `unfinished` where one holds nothing.
template <class... Opaque>
auto with(Opaque*... memory) {
  return [=](auto&& f) {
    const auto call = [&](auto*... of) {
      using Result = decltype(f(*of...));
      return answer((of && ...) ? f(*of...) : Result{kUnfinished});
    };
    return call(held(memory)...);
  };
}

/// Makes a struct in a caller's memory: f(struct), which holds nothing if that fails.
/// @param sound  of its settings
template <class Opaque, class F>
Outcome begun(Outcome sound, Opaque* memory, std::size_t size, F&& f) {
  if (!sound) return sound;
  auto* made = Held<Opaque>::make(memory, size);
  if (made == nullptr) return kTooSmall;
  const Outcome outcome = f(*made);
  if (!outcome) made->mark = 0;
  return outcome;
}

/// A C array or struct as the core's, and back.
template <class Core, class C>
Core in(const C* from) {
  if constexpr (!std::is_same_v<C, truepose_real>) return converted<Core>(*from);
  Core result{};
  std::memcpy(static_cast<void*>(&result), from, sizeof result);
  return result;
}
template <class Core, class C>
void out(const Core& from, C* to) {
  std::memcpy(to, &from, std::is_same_v<C, truepose_real> ? sizeof from : sizeof *to);
}

/// f(robot, found) of a loaded model; `found` goes to `to` where there is an answer.
template <class Core, class C, class F>
auto computed(const truepose_model* model, C* to, Core found, F&& f) {
  return with(model)([&](const Robot& robot) {
    const auto result = f(robot, found);
    if (result) out(found, to);
    return result;
  });
}

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
    knowledge = in<Knowledge>(known);
    weighing = {&knowledge, work, kept};
  }
  Known(const Known&) = delete;
  Known& operator=(const Known&) = delete;
};
}  // namespace truepose::c
