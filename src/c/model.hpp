// The core's structs in memory from C callers, after a marker word; C's values as the core's.
#pragma once

#include <cstdint>
#include <functional>
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

template <class C>
concept Opaque = requires { sizeof(Held<std::remove_const_t<C>>); };

/// What a memory holds, of a model the loaded robot, else nullptr.
template <Opaque C>
auto* held(C* memory) {
  auto* made = Held<std::remove_const_t<C>>::of(memory);
  if constexpr (requires { made->robot; })
    return made && made->robot.finished ? &made->robot : nullptr;
  else
    return made;
}
/// Anything else is always there.
constexpr bool held(const auto&) { return true; }

inline constexpr Outcome kUnfinished{Status::unfinished}, kTooSmall{Status::too_small};

inline auto answer(const Outcome& of) { return converted<truepose_outcome>(of); }
inline auto answer(const FkmResult& of) { return converted<truepose_fkm_result>(of); }
inline auto answer(const Estimate& of) { return converted<truepose_estimate_result>(of); }

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

/// Marks a result of C that is read as well.
template <class C>
struct Both {
  C* to;
};

/// A result: C reads it where there is an answer.
template <class C, class Result, class Core>
struct Written {
  C* to;
  const Result& result;
  Core core;

  operator Core&() { return core; }
  ~Written() {
    if (result) out(core, to);
  }
};

/// An argument of C as a parameter of type P: what a memory holds, a core's array or struct, one to
/// be written, or itself.
template <class P, class A>
decltype(auto) taken(A given, const auto& result) {
  using Core = std::remove_cvref_t<P>;
  if constexpr (!std::is_reference_v<P>)
    return given;
  else if constexpr (Opaque<std::remove_pointer_t<A>>)
    return (*held(given));
  else if constexpr (std::is_const_v<std::remove_reference_t<P>>)
    return in<Core>(given);
  else if constexpr (requires { given.to; })
    return Written{given.to, result, in<Core>(given.to)};
  else
    return Written{given, result, Core{}};
}

/// with(arguments of C, …)(f): f of them as the types of its parameters say, or `unfinished` where
/// a memory holds nothing.
template <class... A>
auto with(A... given) {
  return [=](const auto& f) {
    return [&]<class R, class... P>(std::type_identity<std::function<R(P...)>>) {
      std::conditional_t<std::is_void_v<R>, Outcome, R> result{kUnfinished};
      if (!(held(given) && ...)) return answer(result);
      if constexpr (std::is_void_v<R>)
        result = {}, f(taken<P>(given, result)...);
      else
        result = f(taken<P>(given, result)...);
      return answer(result);
    }(std::type_identity<decltype(std::function{f})>{});
  };
}

/// Makes a struct in a caller's memory: f(struct), which holds nothing if that fails.
/// @param sound  of its settings
template <class Opaque, class F>
Outcome begun(Outcome sound, Opaque* memory, std::size_t size, F&& f) {
  if (!sound) return sound;
  auto* made = Held<Opaque>::make(memory, size);
  if (made == nullptr) return kTooSmall;
  if constexpr (std::is_void_v<decltype(f(*made))>)
    f(*made);
  else
    sound = f(*made);
  if (!sound) made->mark = 0;
  return sound;
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
