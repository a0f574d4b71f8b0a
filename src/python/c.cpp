// The C interface's tables of a robot as text, for `truepose export c`. No mathematics.
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

#include "c/description.hpp"
#include "python/arrays.hpp"
#include "python/fault_tolerant_setup.hpp"

namespace truepose::python {
namespace {
/// Collects the integers of a C struct, and (name, number or numbers), in its order.
struct Listed {
  nb::list whole, rows;

  void operator()(const char*, const std::int32_t& number, const auto&) { whole.append(number); }
  void operator()(const char* name, const truepose_real& number, const auto&) {
    rows.append(nb::make_tuple(name, number));
  }
  template <std::size_t N>
  void operator()(const char* name, const truepose_real (&numbers)[N], const auto&) {
    nb::list values;
    for (const truepose_real number : numbers) values.append(number);
    rows.append(nb::make_tuple(name, values));
  }
};

nb::tuple listed(const auto& c, const auto& core, Listed all = {}) {
  c::fields(c, core, all);
  if (nb::len(all.whole) % 2) all.whole.append(0);  // `unused`
  return nb::make_tuple(all.whole, all.rows);
}
nb::list listed(const auto& c, const auto& core, int count) {
  nb::list parts;
  for (int k = 0; k < count; ++k) parts.append(listed(c[k], core[k]));
  return parts;
}

nb::dict description(const Robot& robot) {
  static truepose_description of;  // 8 kB
  c::describe(robot, of);
  nb::dict result;
  result["head"] = listed(of, robot);
  result["chain"] = listed(of.chain, robot.chain, of.chains);
  result["sensor"] = listed(of.sensor, robot.sensor, std::max(of.sensors, 1));
  result["body"] = listed(of.body, robot.body, std::max(of.bodies, 1));  // no empty initialiser
  result["axis"] = listed(of.axis, robot.axis, passive_axes(robot.mobility));
  return result;
}

template <class C, class Core>
nb::tuple settings(const Core& core) {
  C of;
  c::describe(core, of);
  Listed all;
  all.whole.append(of.size);
  return listed(of, core, all);
}

/// Bytes of a struct, for programs on the same kind of machine.
template <class C, class Core>
nb::bytes image_of(const Core& core) {
  static C of;  // 8 kB
  c::describe(core, of);
  return nb::bytes(reinterpret_cast<const char*>(&of), sizeof of);
}

/// Columns of H_ξ, S and the readings' σ.
nb::tuple knowledge(const Known& known) {
  return nb::make_tuple(known.column, known.root, known.sigma);
}
}  // namespace

void bind_c(nb::module_& m) {
  using namespace nb::literals;
  m.attr("c_abi") = TRUEPOSE_ABI;
  m.def("c_description", &description, "robot"_a);
  m.def("c_control", &settings<truepose_control_settings, ControlSettings>, "settings"_a);
  m.def(
      "c_fault_monitor",
      [](const FaultTolerantSetup& of) {
        return settings<truepose_fault_monitor_settings>(of.settings);
      },
      "fault_setup"_a);
  m.def("c_knowledge", &knowledge, "known"_a);
  m.def("c_description_bytes", &image_of<truepose_description, Robot>, "robot"_a);
  m.def(
      "c_fault_monitor_bytes",
      [](const FaultTolerantSetup& of) {
        return image_of<truepose_fault_monitor_settings>(of.settings);
      },
      "fault_setup"_a);
}
}  // namespace truepose::python
