// Bindings of whole lists: fields of a struct, members of an enumeration.
#pragma once

#include <nanobind/nanobind.h>

#include <initializer_list>

// TRUEPOSE_FIELDS(of, def_rw, a, b) binds members a and b of the class of `of` by their names. The
// preprocessor has no loops: each element's text calls for the next one, and is scanned again.
#define TRUEPOSE_FIELDS(of, how, ...) TRUEPOSE_SCAN(TRUEPOSE_FIELD(of, how, __VA_ARGS__))
#define TRUEPOSE_FIELD(of, how, member, ...)    \
  of.how(#member, &decltype(of)::Type::member); \
  __VA_OPT__(TRUEPOSE_NEXT TRUEPOSE_CALL(of, how, __VA_ARGS__))
#define TRUEPOSE_NEXT() TRUEPOSE_FIELD
#define TRUEPOSE_CALL ()
#define TRUEPOSE_SCAN(...) TRUEPOSE_SCAN9(TRUEPOSE_SCAN9(TRUEPOSE_SCAN9(__VA_ARGS__)))
#define TRUEPOSE_SCAN9(...) TRUEPOSE_SCAN3(TRUEPOSE_SCAN3(TRUEPOSE_SCAN3(__VA_ARGS__)))
#define TRUEPOSE_SCAN3(...) TRUEPOSE_SCAN1(TRUEPOSE_SCAN1(TRUEPOSE_SCAN1(__VA_ARGS__)))
#define TRUEPOSE_SCAN1(...) __VA_ARGS__

namespace truepose::python {

/// An enumeration whose members count from 0 in this order.
template <class Enum>
void enumeration(nanobind::module_& m, const char* name,
                 std::initializer_list<const char*> members) {
  nanobind::enum_<Enum> bound(m, name);
  int value = 0;
  for (const char* member : members) bound.value(member, static_cast<Enum>(value++));
}

}  // namespace truepose::python
