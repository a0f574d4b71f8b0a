// The C interface's tables of a robot as text, for `truepose export c`. No mathematics.
#include <nanobind/eigen/dense.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

#include "arrays.hpp"
#include "c/description.hpp"
#include "fault_tolerant_setup.hpp"

namespace truepose::python {
namespace {

/// Collects (name, number or numbers), in the order of a C struct.
struct Listed {
  nb::list rows;

  void operator()(const char* name, const truepose_real& number, const auto&) {
    rows.append(nb::make_tuple(name, number));
  }
  template <std::size_t N>
  void operator()(const char* name, const truepose_real (&numbers)[N], const auto&) {
    rows.append(nb::make_tuple(name, list(numbers)));
  }
  template <std::size_t N>
  static nb::list list(const truepose_real (&numbers)[N]) {
    nb::list values;
    for (const truepose_real number : numbers) values.append(number);
    return values;
  }
};

nb::dict description(const Robot& robot) {
  static truepose_description of;  // 8 kB
  c::describe(robot, of);
  nb::list chains, sensors, bodies, axes;
  for (int i = 0; i < of.chains; ++i) {
    const truepose_chain& chain = of.chain[i];
    Listed listed;
    c::chain_fields(chain, robot.chain[i], listed);
    chains.append(nb::make_tuple(nb::make_tuple(chain.actuator, chain.working_mode, chain.bar, 0),
                                 listed.rows));
  }
  for (int k = 0; k < std::max(of.sensors, 1); ++k) {  // C has no empty initialiser
    const truepose_sensor& sensor = of.sensor[k];
    Listed listed;
    c::sensor_fields(sensor, robot.sensor[k], listed);
    sensors.append(nb::make_tuple(nb::make_tuple(sensor.kind, sensor.chain, sensor.at_nacelle,
                                                 sensor.rod, sensor.bar, sensor.axis),
                                  listed.rows));
  }
  for (int k = 0; k < std::max(of.bodies, 1); ++k) {
    Listed listed;
    c::body_fields(of.body[k], robot.body[k], listed);
    bodies.append(nb::make_tuple(nb::make_tuple(of.body[k].bar, 0), listed.rows));
  }
  for (int j = 0; j < passive_axes(robot.mobility); ++j) {
    Listed listed;
    c::axis_fields(of.axis[j], robot.axis[j], listed);
    axes.append(nb::make_tuple(nb::make_tuple(), listed.rows));
  }
  nb::dict result;
  result["counts"] = nb::make_tuple(of.mobility, of.chains, of.motors, of.sensors, of.bodies,
                                    of.bar_joint, of.level, 0);
  result["gravity"] = Listed::list(of.gravity);
  result["home"] = Listed::list(of.home);
  result["chain"] = chains;
  result["sensor"] = sensors;
  result["body"] = bodies;
  result["axis"] = axes;
  return result;
}

nb::tuple control_settings(const ControlSettings& settings) {
  truepose_control_settings of;
  c::describe(settings, of);
  Listed listed;
  c::control_fields(of, settings, listed);
  return nb::make_tuple(nb::make_tuple(of.law, of.gains, of.feed_forward, of.sigma_scale),
                        listed.rows);
}

nb::tuple watch_settings(const FaultTolerantSetup& guarding) {
  truepose_fault_monitor_settings of;
  c::describe(guarding.settings, of);
  Listed listed;
  c::watch_fields(of, guarding.settings.watch, guarding.settings, listed);
  return nb::make_tuple(nb::make_tuple(of.refresh, of.coast, of.decide, of.spikes, of.within, 0),
                        listed.rows);
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
  m.def("c_control", &control_settings, "settings"_a);
  m.def("c_watch", &watch_settings, "guarding"_a);
  m.def("c_knowledge", &knowledge, "known"_a);
  m.def("c_description_bytes", &image_of<truepose_description, Robot>, "robot"_a);
  m.def(
      "c_watch_bytes",
      [](const FaultTolerantSetup& of) {
        return image_of<truepose_fault_monitor_settings>(of.settings);
      },
      "guarding"_a);
}

}  // namespace truepose::python
