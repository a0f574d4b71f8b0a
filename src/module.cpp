// Python bindings of the core's structs, field by field. No mathematics.
#include <nanobind/eigen/dense.h>
#include <nanobind/nanobind.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/pair.h>

#include "arrays.hpp"
#include "truepose/control/law.hpp"
#include "truepose/model/geometry.hpp"

/// Vectors of a robot as numpy arrays, copied.
template <class Numbers>
struct nanobind::detail::type_caster<truepose::Plain<Numbers>> {
  using Caster = make_caster<Numbers>;
  NB_TYPE_CASTER(truepose::Plain<Numbers>, Caster::Name)

  bool from_python(handle from, std::uint8_t flags, cleanup_list* cleanup) noexcept {
    Caster caster;
    if (!caster.from_python(from, flags, cleanup)) return false;
    value = caster.operator cast_t<Numbers&>();
    return true;
  }
  static handle from_cpp(const Numbers& numbers, rv_policy, cleanup_list* cleanup) noexcept {
    return Caster::from_cpp(numbers, rv_policy::copy, cleanup);
  }
};

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

/// The core's tables of sensor kinds, laws and ξ for Python.
void bind_tables(nb::module_& m) {
  nb::class_<SensorProperties>(m, "SensorProperties")
      .def_ro("name", &SensorProperties::name)
      .def_prop_ro("unit", [](const SensorProperties& row) { return text(row.unit); })
      .def_ro("of_chain", &SensorProperties::of_chain)
      .def_ro("shaft", &SensorProperties::shaft)
      .def_ro("wraps", &SensorProperties::wraps)
      .def_ro("is_theta", &SensorProperties::is_theta)
      .def_prop_ro("mounting", [](const SensorProperties& row) {
        nb::list vectors;
        for (unsigned k = 0; k < kMountingVectors.size(); ++k)
          if (row.mounting & (1u << k)) vectors.append(kMountingVectors[k]);
        return nb::tuple(vectors);
      });
  nb::dict kinds, laws;
  for (const SensorProperties& row : kSensorTable) kinds[row.name] = nb::cast(row);
  m.attr("sensor_kinds") = kinds;
  nb::enum_<Law> law(m, "Law");
  for (const LawProperties& row : kLawTable) law.value(row.name, row.law);
  nb::class_<LawProperties>(m, "LawProperties")
      .def_ro("name", &LawProperties::name)
      .def_ro("law", &LawProperties::law)
      .def_ro("weighs", &LawProperties::weighs)
      .def_ro("sensed", &LawProperties::sensed);
  for (const LawProperties& row : kLawTable) laws[row.name] = nb::cast(row);
  m.attr("laws") = laws;
  m.attr("chain_parameters") = named(kChainTable);
  m.attr("sensor_parameters") = named(kSensorParameterTable);
  m.attr("axis_parameters") = named(kAxisTable);
}

void bind_robot(nb::module_& m) {
  nb::enum_<Mobility>(m, "Mobility")
      .value("planar_translation", Mobility::planar_translation)
      .value("planar", Mobility::planar)
      .value("translation", Mobility::translation)
      .value("schoenflies", Mobility::schoenflies)
      .value("spatial", Mobility::spatial)
      .value("pivot_1", Mobility::pivot_1)
      .value("pivot_2", Mobility::pivot_2)
      .value("pivot_3", Mobility::pivot_3);
  nb::enum_<Actuator>(m, "Actuator")
      .value("revolute", Actuator::revolute)
      .value("prismatic", Actuator::prismatic)
      .value("telescopic", Actuator::telescopic);
  nb::enum_<SensorKind> kinds(m, "SensorKind");
  for (const SensorProperties& row : kSensorTable) kinds.value(row.name, row.kind);
  nb::enum_<BarJoint>(m, "BarJoint")
      .value("pivots", BarJoint::pivots)
      .value("four_bar", BarJoint::four_bar);
  nb::enum_<Level>(m, "Level").value("ideal", Level::ideal).value("full", Level::full);
  nb::enum_<FullKind>(m, "FullKind")
      .value("undescribed", FullKind::undescribed)
      .value("same", FullKind::same)
      .value("exists", FullKind::exists)
      .value("overconstrained", FullKind::overconstrained)
      .value("loose", FullKind::loose)
      .value("elastic", FullKind::elastic);
  nb::class_<FullLevel>(m, "FullLevel")
      .def_ro("kind", &FullLevel::kind)
      .def_ro("rods", &FullLevel::rods)
      .def_ro("unknowns", &FullLevel::unknowns)
      .def_ro("excess", &FullLevel::excess);

  nb::class_<Chain>(m, "Chain")
      .def(nb::init<>())
      .def_rw("actuator", &Chain::actuator)
      .def_rw("working_mode", &Chain::working_mode)
      .def_rw("base", &Chain::base)
      .def_rw("axis", &Chain::axis)
      .def_rw("zero", &Chain::zero)
      .def_rw("arm", &Chain::arm)
      .def_rw("rod", &Chain::rod)
      .def_rw("encoder_offset", &Chain::encoder_offset)
      .def_rw("encoder_gain", &Chain::encoder_gain)
      .def_rw("encoder_buildup", &Chain::encoder_buildup)
      .def_rw("pivot", &Chain::pivot)
      .def_rw("anchor", &Chain::anchor)
      .def_rw("encoder_step", &Chain::encoder_step)
      .def_rw("encoder_noise", &Chain::encoder_noise)
      .def_rw("low", &Chain::low)
      .def_rw("high", &Chain::high)
      .def("set_eccentricity", &set_eccentricity<Chain>)
      .def_rw("torque_limit", &Chain::torque_limit)
      .def_rw("drive_inertia", &Chain::drive_inertia)
      .def_rw("arm_mass", &Chain::arm_mass)
      .def_rw("rod_mass", &Chain::rod_mass)
      .def_rw("viscous", &Chain::viscous)
      .def_rw("coulomb", &Chain::coulomb)
      .def_rw("bar", &Chain::bar)
      .def_rw("rod_spacing", &Chain::rod_spacing)
      .def_rw("rod_difference", &Chain::rod_difference)
      .def_rw("pair_axis", &Chain::pair_axis)
      .def_rw("pair_drawn", &Chain::pair_drawn);
  nb::class_<Sensor>(m, "Sensor")
      .def(nb::init<>())
      .def_rw("kind", &Sensor::kind)
      .def_rw("chain", &Sensor::chain)
      .def_rw("at_nacelle", &Sensor::at_nacelle)
      .def_rw("rod", &Sensor::rod)
      .def_rw("gain", &Sensor::gain)
      .def_rw("offset", &Sensor::offset)
      .def_rw("step", &Sensor::step)
      .def_rw("noise", &Sensor::noise)
      .def("set_eccentricity", &set_eccentricity<Sensor>)
      .def_rw("weight", &Sensor::weight)
      .def_rw("origin", &Sensor::origin)
      .def_rw("direction", &Sensor::direction)
      .def_rw("target", &Sensor::target)
      .def_rw("normal", &Sensor::normal)
      .def_rw("bar", &Sensor::bar)
      .def_rw("axis", &Sensor::axis);
  nb::class_<PassiveAxis>(m, "PassiveAxis")
      .def(nb::init<>())
      .def_rw("origin", &PassiveAxis::origin)
      .def_rw("direction", &PassiveAxis::direction)
      .def_rw("low", &PassiveAxis::low)
      .def_rw("high", &PassiveAxis::high);
  nb::class_<Body>(m, "Body")
      .def(nb::init<>())
      .def_rw("mass", &Body::mass)
      .def_rw("bar", &Body::bar)
      .def_rw("pivot", &Body::pivot)
      .def_rw("anchor", &Body::anchor)
      .def_rw("inertia", &Body::inertia);

  // Element access copies: the facade builds a robot once, from the outside in.
  nb::class_<Robot>(m, "Robot")
      .def(nb::init<>())
      .def_rw("mobility", &Robot::mobility)
      .def_rw("gravity", &Robot::gravity)
      .def_rw("home", &Robot::home)
      .def_prop_ro("n", [](const Robot& robot) { return dof(robot.mobility); })
      .def_rw("chains", &Robot::chains)
      .def_rw("motors", &Robot::motors)
      .def_ro("r", &Robot::r)
      .def_ro("assembly_sign", &Robot::assembly_sign)
      .def_rw("bar_joint", &Robot::bar_joint)
      .def_ro("full", &Robot::full)
      .def_rw("level", &Robot::level)
      .def("chain", [](const Robot& robot, int i) { return robot.chain.at(i); })
      .def("set_chain",
           [](Robot& robot, int i, const Chain& chain) {
             robot.chain.at(i) = chain;
             robot.finished = false;
           })
      .def_prop_ro("axes", [](const Robot& robot) { return passive_axes(robot.mobility); })
      .def("axis", [](const Robot& robot, int j) { return robot.axis.at(j); })
      .def("set_axis",
           [](Robot& robot, int j, const PassiveAxis& axis) {
             robot.axis.at(j) = axis;
             robot.finished = false;
           })
      .def_ro("bodies", &Robot::bodies)
      .def("body", [](const Robot& robot, int i) { return robot.body.at(i); })
      .def("add_sensor",
           [](Robot& robot, const Sensor& sensor) {
             robot.sensor.at(robot.r) = sensor;
             ++robot.r;
             robot.finished = false;
           })
      .def("add_body",
           [](Robot& robot, const Body& body) {
             robot.body.at(robot.bodies) = body;
             ++robot.bodies;
             robot.finished = false;
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
             return robot;
           })
      .def("finish", [](Robot& robot) {
        Outcome outcome = finish(robot);
        if (outcome) outcome = finish_full(robot);
        return std::pair(static_cast<int>(outcome.status), outcome.chain);
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
  python::bind_robot(m);
  python::bind_control(m);
  python::bind_simulation(m);
  python::bind_batch(m);
  python::bind_calibration(m);
  python::bind_plant(m);
  python::bind_fault_monitor(m);
  python::bind_c(m);
}
