// Structs of the core as Python classes by tables of their members.
#pragma once

#include "c/fields.hpp"
#include "python/arrays.hpp"

// TRUEPOSE_MEMBERS(T, a, b, …): a table of these members of a struct that C does not have.
#define TRUEPOSE_MEMBERS(T, ...)                                                             \
  [] {                                                                                       \
    static constexpr c::Field fields[] = {TRUEPOSE_EACH(TRUEPOSE_FIELD, T, T, __VA_ARGS__)}; \
    return c::Table{fields, 0};                                                              \
  }()

namespace truepose::python {
namespace fields_detail = c::fields_detail;

/// numpy's type of a struct of this size with the members of a table.
nb::object type_of(const c::Table& table, std::size_t size);

/// A member of a struct: numbers are int or float, arrays are numpy's and may be set to shorter
/// ones, then the rest is 0.
nb::object get_member(nb::handle self, nb::handle type, const char* name);
void set_member(nb::handle self, nb::handle type, const char* name, nb::handle value);

/// A struct as a class with default values and an attribute for each member. `fields` has their
/// names in order; bytes() are those of the struct in C.
template <class T>
nb::class_<T> structure(nb::module_& m, const char* name, const c::Table& table) {
  const nb::object type = type_of(table, sizeof(T));
  nb::class_<T> made(m, name);
  made.def(nb::init<>())
      .def(
          "__getattr__",
          [type](nb::handle self, const char* member) { return get_member(self, type, member); },
          nb::sig("def __getattr__(self, name: str) -> typing.Any"))
      .def("__setattr__", [type](nb::handle self, const char* member, nb::handle value) {
        set_member(self, type, member, value);
      });
  made.attr("fields") = type.attr("names");
  if (table.size > 0)
    made.def("__bytes__", [size = table.size](const T& own) { return nb::bytes(&own, size); });
  return made;
}
/// Those of C, by their names in the core.
template <class... T>
void structures(nb::module_& m) {
  (structure<T>(m, c::table_of<T>.name, c::table_of<T>), ...);
}

/// Records as a structured numpy array, a copy of theirs, with these members.
template <class T>
nb::object records(const std::vector<T>& rows, const c::Table& table) {
  return numpy("ndarray")(rows.size(), type_of(table, sizeof(T)),
                          nb::bytes(rows.data(), rows.size() * sizeof(T)));
}
}  // namespace truepose::python
