// Structs of the core as Python classes, and their enumerations, by tables of their members.
#pragma once

#include <string>

#include "c/fields.hpp"
#include "python/arrays.hpp"

// TRUEPOSE_MEMBERS(T, a, b, …): a table of these members of a struct that C does not have.
#define TRUEPOSE_MEMBERS(T, ...)                                                              \
  [] {                                                                                        \
    static constexpr c::Field fields[] = {TRUEPOSE_EACH(TRUEPOSE_MEMBER, T, T, __VA_ARGS__)}; \
    return c::Table{fields, 0};                                                               \
  }()
#define TRUEPOSE_MEMBER(T, same, member) \
  c::fields_detail::field<decltype(T::member)>(#member, offsetof(T, member)),

namespace truepose::python {
/// A member, and Python's signatures of its getter and setter.
nb::object get_member(nb::handle self, const c::Field& field);
void set_member(nb::handle self, const c::Field& field, nb::handle value);
std::array<std::string, 2> signatures(const c::Field& field);

/// A struct as a class with default values, copies, and an attribute for each member: numbers are
/// int or float, arrays are numpy's and may be set to shorter ones, then the rest is 0. `fields`
/// has the names in order; bytes() are those of the struct in C.
template <class T>
nb::class_<T> structure(nb::module_& m, const char* name, const c::Table& table) {
  nb::class_<T> made(m, name);
  made.def(nb::init<>()).def("copy", [](const T& own) { return own; });
  nb::list names;
  for (const c::Field& field : table.fields) {
    const auto [reads, writes] = signatures(field);
    made.def_prop_rw(
        field.name, [&field](nb::handle self) { return get_member(self, field); },
        [&field](nb::handle self, nb::handle value) { set_member(self, field, value); },
        nb::for_getter(nb::sig(reads.c_str())), nb::for_setter(nb::sig(writes.c_str())));
    names.append(field.name);
  }
  made.attr("fields") = nb::tuple(names);
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
nb::object records(const void* data, std::size_t count, std::size_t size, const c::Table& table);
template <class T>
nb::object records(const std::vector<T>& rows, const c::Table& table) {
  return records(rows.data(), rows.size(), sizeof(T), table);
}

/// An IntEnum whose members count from 0 in this order.
void enumeration(nb::module_& m, const char* name, const std::vector<const char*>& members);

/// Names of a table's rows.
template <class Table>
std::vector<const char*> names_of(const Table& table) {
  std::vector<const char*> names;
  for (const auto& row : table) names.push_back(row.name);
  return names;
}
}  // namespace truepose::python
