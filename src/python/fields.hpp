// Bindings of whole lists: fields of a struct, members of an enumeration.
#pragma once

#include <nanobind/nanobind.h>

#include <initializer_list>

#include "c/each.hpp"

// TRUEPOSE_FIELDS(of, def_rw, a, b) binds members a and b of the class of `of` by their names.
#define TRUEPOSE_FIELDS(of, how, ...) TRUEPOSE_EACH(TRUEPOSE_BIND, of, how, __VA_ARGS__)
#define TRUEPOSE_BIND(of, how, member) of.how(#member, &decltype(of)::Type::member);

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
