// Alternatives that tests/cpp_mutants.py writes into a copy of the core: each does what the core
// does, or what mutant K does where the environment says TRUEPOSE_MUTANT=K.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <type_traits>

namespace mutants {
inline bool on(int k) {
  static const int chosen = [] {
    const char* said = std::getenv("TRUEPOSE_MUTANT");
    return said ? std::atoi(said) : 0;
  }();
  return k == chosen;
}

template <int K, class T>
T number(T right, std::type_identity_t<T> wrong) {
  return on(K) ? wrong : right;
}

#define TRUEPOSE_ALTERNATIVE_CALL(RIGHT, WRONG)           \
  template <int K, class... T>                            \
  auto RIGHT(const T&... of) {                            \
    return on(K) ? std::WRONG(of...) : std::RIGHT(of...); \
  }
TRUEPOSE_ALTERNATIVE_CALL(min, max)
TRUEPOSE_ALTERNATIVE_CALL(max, min)
TRUEPOSE_ALTERNATIVE_CALL(sin, cos)
TRUEPOSE_ALTERNATIVE_CALL(cos, sin)

/// The type of a computed value; of Eigen's expressions, the matrix.
template <class T>
struct Value {
  using type = T;
};
template <class T>
  requires requires { typename T::PlainObject; }
struct Value<T> {
  using type = typename T::PlainObject;
};

template <int K, class Right, class Wrong>
auto one_of(Right&& right, Wrong&& wrong) {
  using T = typename Value<std::decay_t<decltype(right())>>::type;
  return on(K) ? T(wrong()) : T(right());
}

/// Instead of a product: the quotient, or the negative of matrices, which have none.
template <class A, class B>
auto not_times(const A& a, const B& b) {
  if constexpr (requires { a / b; })
    return a / b;
  else
    return -(a * b);
}

/// a + b is written a + Swap<K>{} + b, which keeps the precedence.
template <int K>
struct Swap {};

#define TRUEPOSE_ALTERNATIVE(NAME, RIGHT, WRONG)                        \
  template <class A, int K>                                             \
  struct NAME {                                                         \
    const A& a;                                                         \
  };                                                                    \
  template <class A, int K>                                             \
  NAME<A, K> operator RIGHT(const A& a, Swap<K>) {                      \
    return {a};                                                         \
  }                                                                     \
  template <class A, int K, class B>                                    \
  auto operator RIGHT(NAME<A, K> left, const B& b) {                    \
    const A& a = left.a;                                                \
    return one_of<K>([&] { return a RIGHT b; }, [&] { return WRONG; }); \
  }
TRUEPOSE_ALTERNATIVE(Plus, +, a - b)
TRUEPOSE_ALTERNATIVE(Minus, -, a + b)
TRUEPOSE_ALTERNATIVE(Times, *, not_times(a, b))
TRUEPOSE_ALTERNATIVE(Over, /, a* b)
TRUEPOSE_ALTERNATIVE(Less, <, a >= b)
TRUEPOSE_ALTERNATIVE(AtLeast, >=, a < b)
TRUEPOSE_ALTERNATIVE(More, >, a <= b)
TRUEPOSE_ALTERNATIVE(AtMost, <=, a > b)
TRUEPOSE_ALTERNATIVE(Same, ==, a != b)
TRUEPOSE_ALTERNATIVE(Other, !=, a == b)

/// a += b is written a += Swap<K>{} += b, which C++ reads from the right.
#define TRUEPOSE_ALTERNATIVE_STEP(NAME, RIGHT, WRONG) \
  template <class B, int K>                           \
  struct NAME {                                       \
    const B& b;                                       \
  };                                                  \
  template <int K, class B>                           \
  NAME<B, K> operator RIGHT(Swap<K>, const B& b) {    \
    return {b};                                       \
  }                                                   \
  template <class A, class B, int K>                  \
  void operator RIGHT(A&& a, NAME<B, K> right) {      \
    if (on(K))                                        \
      a WRONG right.b;                                \
    else                                              \
      a RIGHT right.b;                                \
  }
TRUEPOSE_ALTERNATIVE_STEP(Added, +=, -=)
TRUEPOSE_ALTERNATIVE_STEP(Subtracted, -=, +=)
}  // namespace mutants
