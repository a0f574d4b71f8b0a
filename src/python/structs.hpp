// Structs of the core as Python classes by tables of their members.
#pragma once

#include "c/fields.hpp"
#include "python/arrays.hpp"

namespace truepose::c {
TRUEPOSE_MEMBERS(DisturbanceReport, disturbance, motor, size, force)
TRUEPOSE_MEMBERS(GuardReport, state, cause, part, brakes, torque, follows)
}  // namespace truepose::c

namespace truepose::python {
/// numpy's type of a struct of this size with the members of a table.
nb::object type_of(const c::Table& table, std::size_t size);

/// A member of a struct: numbers are int or float; arrays are numpy's and may be set to shorter
/// ones, then the rest is 0; structs are records, whose `base` is record["base"]: numpy has an
/// attribute of this name. Those read are copies.
nb::object get_member(nb::handle self, nb::handle type, const char* name);
void set_member(nb::handle self, nb::handle type, const char* name, nb::handle value);

/// A struct as a class with default values and an attribute for each member of these tables.
/// `fields` has their names in order; bytes() are those of the struct in C.
template <class T>
nb::class_<T> structure(nb::module_& m) {
  constexpr const c::Table& table = c::table_of<T>;
  const nb::object type = type_of(table, sizeof(T));
  nb::class_<T> made(m, table.name);
  made.def(nb::init<>())
      .def(
          "__getattr__",
          [type](nb::handle self, const char* member) { return get_member(self, type, member); },
          nb::sig("def __getattr__(self, name: str) -> typing.Any"))
      .def("__setattr__", [type](nb::handle self, const char* member, nb::handle value) {
        if constexpr (std::is_same_v<T, Robot>) nb::inst_ptr<Robot>(self)->finished = false;
        set_member(self, type, member, value);
      });
  made.attr("fields") = type.attr("names");
  if (table.size > 0)
    made.def("__bytes__", [](const T& own) { return nb::bytes(&own, c::table_of<T>.size); });
  return made;
}

/// Records as a structured numpy array, a copy of theirs.
template <class T>
nb::object records(const std::vector<T>& rows) {
  return numpy("ndarray")(rows.size(), type_of(c::table_of<T>, sizeof(T)),
                          nb::bytes(rows.data(), rows.size() * sizeof(T)));
}
}  // namespace truepose::python
