// Python bindings of the core's structs, field by field. No mathematics.
#include <nanobind/nanobind.h>
#include <nanobind/stl/array.h>

#include "control/law.hpp"
#include "mechanism/geometry.hpp"
#include "python/arrays.hpp"
#include "python/fields.hpp"
#include "python/vectors.hpp"

namespace truepose::python {
namespace {
/// c1, s1, c2, s2 and the gear of an encoder.
template <class Part>
void set_eccentricity(Part& part, const std::array<double, 4>& amplitude, double gear) {
  part.eccentricity.amplitude = amplitude;
  part.eccentricity.gear = gear;
}

/// Throws if the core failed. @throws nb::value_error
void asked(Outcome outcome) {
  if (!outcome) throw nb::value_error(describe(outcome.status));
}
/// The robot as one to finish again.
Robot& edited(Robot& robot) {
  robot.finished = false;
  return robot;
}
/// Refuses an unfinished robot, whose columns of ξ may be out of bounds.
const Robot& sound(const Robot& robot) {
  if (!robot.finished) throw nb::value_error(describe(Status::unfinished));
  return robot;
}

const char* text(Unit unit) {
  switch (unit) {
    case Unit::metre: return "m";
    case Unit::radian: return "rad";
    case Unit::reading: return "reading";
    default: return "";
  }
}

/// Names of a part's parameters, in ξ's order, with units.
template <class Table>
nb::tuple named(const Table& table) {
  nb::list rows;
  for (const auto& row : table) rows.append(nb::make_tuple(row.name, text(row.unit)));
  return nb::tuple(rows);
}

/// A table's rows by name.
template <class Table>
nb::dict by_name(const Table& table) {
  nb::dict rows;
  for (const auto& row : table) rows[row.name] = nb::cast(row);
  return rows;
}

/// The core's tables of sensor kinds, laws and ξ for Python.
void bind_tables(nb::module_& m) {
  nb::class_<SensorProperties> kind(m, "SensorProperties");
  TRUEPOSE_FIELDS(kind, def_ro, name, of_chain, shaft, wraps, is_theta);
  kind.def_prop_ro("unit", [](const SensorProperties& row) { return text(row.unit); });
  kind.def_prop_ro("mounting", [](const SensorProperties& row) {
    nb::list vectors;
    for (unsigned k = 0; k < kMountingVectors.size(); ++k)
      if (row.mounting & (1u << k)) vectors.append(kMountingVectors[k]);
    return nb::tuple(vectors);
  });
  nb::enum_<SensorKind> kinds(m, "SensorKind");
  for (const SensorProperties& row : kSensorTable) kinds.value(row.name, row.kind);
  nb::enum_<Law> laws(m, "Law");
  for (const LawProperties& row : kLawTable) laws.value(row.name, row.law);
  nb::class_<LawProperties> law(m, "LawProperties");
  TRUEPOSE_FIELDS(law, def_ro, name, law, weighs, sensed);
  m.attr("sensor_kinds") = by_name(kSensorTable);
  m.attr("laws") = by_name(kLawTable);
  m.attr("chain_parameters") = named(kChainTable);
  m.attr("sensor_parameters") = named(kSensorParameterTable);
  m.attr("axis_parameters") = named(kAxisTable);
}

void bind_parts(nb::module_& m) {
  enumeration<Mobility>(m, "Mobility",
                        {"planar_translation", "planar", "translation", "schoenflies", "spatial",
                         "rotational_1", "rotational_2", "rotational_3"});
  enumeration<Actuator>(m, "Actuator", {"revolute", "prismatic", "telescopic"});
  enumeration<BarJoint>(m, "BarJoint", {"pivots", "four_bar"});
  enumeration<Level>(m, "Level", {"ideal", "full"});
  enumeration<FullKind>(m, "FullKind",
                        {"undescribed", "same", "exists", "overconstrained", "loose", "elastic"});
  nb::class_<FullLevel> full(m, "FullLevel");
  TRUEPOSE_FIELDS(full, def_ro, kind, rods, unknowns, excess);
  nb::class_<Chain> chain(m, "Chain");
  chain.def(nb::init<>()).def("set_eccentricity", &set_eccentricity<Chain>);
  TRUEPOSE_FIELDS(chain, def_rw, actuator, working_mode, base, axis, zero, arm, rod, encoder_offset,
                  encoder_gain, encoder_buildup, pivot, anchor, encoder_step, encoder_noise, low,
                  high, torque_limit, drive_inertia, arm_mass, rod_mass, viscous, coulomb, bar,
                  rod_spacing, rod_difference, pair_axis, pair_drawn);
  nb::class_<Sensor> sensor(m, "Sensor");
  sensor.def(nb::init<>()).def("set_eccentricity", &set_eccentricity<Sensor>);
  TRUEPOSE_FIELDS(sensor, def_rw, kind, chain, at_nacelle, rod, gain, offset, step, noise, weight,
                  origin, direction, target, normal, bar, axis);
  nb::class_<PassiveAxis> axis(m, "PassiveAxis");
  axis.def(nb::init<>());
  TRUEPOSE_FIELDS(axis, def_rw, origin, direction, low, high);
  nb::class_<Body> body(m, "Body");
  body.def(nb::init<>());
  TRUEPOSE_FIELDS(body, def_rw, mass, bar, pivot, anchor, inertia);
}

void bind_robot(nb::module_& m) {
  // Element access copies: the facade builds a robot once, from the outside in.
  nb::class_<Robot> robot_class(m, "Robot");
  TRUEPOSE_FIELDS(robot_class, def_rw, mobility, gravity, home, chains, motors, bar_joint, level);
  TRUEPOSE_FIELDS(robot_class, def_ro, r, full, bodies);
  robot_class.def(nb::init<>())
      .def_prop_ro("n", [](const Robot& robot) { return dof(robot.mobility); })
      .def_prop_ro("axes", [](const Robot& robot) { return passive_axes(robot.mobility); })
      .def("chain", [](const Robot& robot, int i) { return robot.chain.at(i); })
      .def("axis", [](const Robot& robot, int j) { return robot.axis.at(j); })
      .def("body", [](const Robot& robot, int i) { return robot.body.at(i); })
      .def("set_chain",
           [](Robot& robot, int i, const Chain& chain) { edited(robot).chain.at(i) = chain; })
      .def("set_axis",
           [](Robot& robot, int j, const PassiveAxis& axis) { edited(robot).axis.at(j) = axis; })
      .def("add_sensor",
           [](Robot& robot, const Sensor& sensor) {
             edited(robot).sensor.at(robot.r) = sensor;
             ++robot.r;
           })
      .def("add_body",
           [](Robot& robot, const Body& body) {
             edited(robot).body.at(robot.bodies) = body;
             ++robot.bodies;
           })
      .def_prop_ro("parameter_count", [](const Robot& robot) { return parameter_count(robot); })
      .def("without_limits",
           [](Robot robot) {
             robot.limited = false;
             return robot;
           })
      .def("motor_position",
           [](const Robot& robot, int i, double q) { return motor_position(robot.chain.at(i), q); })
      .def("motor_reading",
           [](const Robot& robot, int i, double position) {
             return motor_reading(robot.chain.at(i), position);
           })
      .def("drawn_parameters",
           [](const Robot& drawn) {
             Owned<double> xi({static_cast<std::size_t>(parameter_count(sound(drawn)))});
             asked(drawn_parameters(drawn, xi[0]));
             return xi.release();
           })
      .def("with_parameters",
           [](const Robot& drawn, const Row& xi) {
             Robot robot = drawn;
             if (xi.shape(0) != static_cast<std::size_t>(parameter_count(sound(drawn))))
               throw nb::value_error("one value for each column");
             asked(set_parameters(drawn, xi.data(), robot));
             static_cast<void>(note_assembly(robot));
             return robot;
           })
      .def("finish", [](Robot& robot) {
        Outcome outcome = finish(robot);
        if (outcome) outcome = finish_full(robot);
        return answered(outcome);
      });
}
}  // namespace
}  // namespace truepose::python

NB_MODULE(_core, m) {
  namespace nb = nanobind;
  using namespace truepose;
  m.doc() = "truepose's real-time core. Use the truepose package; this is its engine.";
  nb::set_leak_warnings(false);  // an interpreter may end with robots alive
  m.attr("max_sensors") = kMaxSensors;
  m.attr("max_readings") = kMaxReadings;
  m.attr("max_bars") = kMaxBars;
  m.attr("max_axes") = kMaxAxes;
  m.attr("joint_limit") = static_cast<int>(Status::joint_limit);
  m.attr("not_converged") = static_cast<int>(Status::not_converged);
  m.attr("singular") = static_cast<int>(Status::singular);
  m.attr("near_singular") = static_cast<int>(Status::near_singular);
  m.attr("unreachable") = static_cast<int>(Status::unreachable);
  m.def("describe", [](int status) { return describe(static_cast<Status>(status)); });
  python::bind_tables(m);
  python::bind_parts(m);
  python::bind_robot(m);
  python::bind_control(m);
  python::bind_simulation(m);
  python::bind_batch(m);
  python::bind_calibration(m);
  python::bind_plant(m);
  python::bind_fault_monitor(m);
  python::bind_safety(m);
  python::bind_start_test(m);
  python::bind_c(m);
}
