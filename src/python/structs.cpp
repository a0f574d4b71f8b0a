// Structs of the core as Python classes, and their enumerations, by tables of their members.
#include "python/structs.hpp"

#include <cmath>
#include <string>

#include "mechanism/geometry.hpp"
#include "simulation/simulate.hpp"

namespace truepose::python {
namespace {
/// A row of a table as a Python object with attributes.
template <class... Value>
nb::object row_of(const char* const (&names)[sizeof...(Value)], const Value&... values) {
  const nb::object made = nb::module_::import_("types").attr("SimpleNamespace")();
  int k = 0;
  ((made.attr(names[k++]) = nb::cast(values)), ...);
  return made;
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
nb::tuple named(const auto& table) {
  nb::list rows;
  for (const auto& row : table) rows.append(nb::make_tuple(row.name, text(row.unit)));
  return nb::tuple(rows);
}

/// The core's tables of sensor kinds, laws, faults and ξ.
void bind_tables(nb::module_& m) {
  nb::dict sensors, laws, faults;
  for (const SensorProperties& row : kSensorTable) {
    nb::list vectors;
    for (unsigned k = 0; k < kMountingVectors.size(); ++k)
      if (row.mounting & (1u << k)) vectors.append(kMountingVectors[k]);
    sensors[row.name] = row_of(
        {"name", "of_chain", "shaft", "wraps", "is_theta", "unit", "mounting"}, row.name,
        row.of_chain, row.shaft, row.wraps, row.is_theta, text(row.unit), nb::tuple(vectors));
  }
  for (const LawProperties& row : kLawTable)
    laws[row.name] = row_of({"name", "law", "weighs", "sensed"}, row.name,
                            static_cast<int>(row.law), row.weighs, row.sensed);
  for (const FaultProperties& row : kFaultTable)
    faults[row.name] =
        row_of({"kind", "size", "lasts", "at_rest", "pair"}, static_cast<int>(row.kind), row.size,
               row.lasts, row.at_rest, row.pair);
  m.attr("sensor_kinds") = sensors;
  m.attr("laws") = laws;
  m.attr("fault_kinds") = faults;
  m.attr("chain_parameters") = named(kChainTable);
  m.attr("sensor_parameters") = named(kSensorParameterTable);
  m.attr("axis_parameters") = named(kAxisTable);
  m.attr("closure_parameters") = named(kClosureTable);
  m.attr("stop_causes") = nb::tuple(nb::cast(names_of(kCauseTable)));
  enumeration(m, "SensorKind", names_of(kSensorTable));
  enumeration(
      m, "Mobility",
      {"planar_translation", "planar", "translation", "schoenflies", "spatial", "rotational_1",
       "rotational_2", "rotational_3", "mechanism_1", "mechanism_2", "mechanism_3"});
  enumeration(m, "JointKind", {"slide", "shift", "hinge", "ball"});
  enumeration(m, "Flaw",
              {"none", "too_many_bodies", "too_many_freedoms", "too_many_closures", "no_such_part",
               "circle", "no_length", "open", "unmoved", "idle", "dependent", "loose"});
  enumeration(m, "Actuator", {"revolute", "prismatic", "telescopic"});
  enumeration(m, "BarJoint", {"pivots", "four_bar"});
  enumeration(m, "Level", {"ideal", "full"});
  enumeration(m, "FullKind",
              {"undescribed", "same", "exists", "overconstrained", "loose", "elastic"});
  enumeration(m, "FeedForward", {"none", "gravity", "full"});
  enumeration(m, "Gains", {"diagonal", "inertia"});
  enumeration(m, "DisturbanceKind", {"none", "payload", "friction", "contact"});
  enumeration(m, "Loss", {"squares", "huber", "student"});
  enumeration(m, "LinkKind", {"plane", "distance", "point"});
  m.attr("symptoms") =
      nb::make_tuple("", "missing", "out of range", "too fast", "stuck", "disagrees", "noisy");
}

/// Throws if the core failed. @throws nb::value_error
void require(Outcome outcome) {
  if (!outcome) throw nb::value_error(describe(outcome.status));
}
/// ξ of a finished robot; of another one, columns may be out of bounds.
std::size_t parameters_of(const Robot& robot) {
  require({robot.finished ? Status::ok : Status::unfinished, -1});
  return static_cast<std::size_t>(parameter_count(robot));
}

/// Reads and writes part i of a robot, by copies: the facade builds a robot from the outside in.
template <class Part, std::size_t N>
void bind_parts(nb::class_<Robot>& made, const char* name, std::array<Part, N> Robot::* parts) {
  made.def(name, [=](const Robot& robot, int i) { return (robot.*parts).at(i); });
  made.def((std::string("set_") + name).c_str(), [=](Robot& robot, int i, const Part& part) {
    robot.finished = false;
    (robot.*parts).at(i) = part;
  });
}

/// J_x at home: a row for each chain, or at the full level for each rod of the free platform; 0
/// where they do not close.
RowMatrix rod_rows(const Robot& robot, bool full) {
  RowMatrix result(full ? robot.full.rods : robot.motors,
                   full ? robot.full.unknowns : dof(robot.mobility));
  std::array<engine::Row, engine::kClosures> rows;
  Closure closure;
  const Outcome outcome =
      full ? full_rows(robot, rows) : ikm(robot, to_pose(robot.mobility, robot.home), closure);
  for (int i = 0; i < result.rows() && outcome; ++i)
    if (full)
      std::copy_n(rows[i].begin(), result.cols(), result[i]);
    else
      jx_row(closure.carried, closure.chain[i].v, closure.chain[i].lever, result[i]);
  return result;
}

void bind_robot(nb::module_& m) {
  auto made = structure<Robot>(m, "Robot", {c::table_of<Robot>.fields, 0});
  bind_parts(made, "chain", &Robot::chain);
  bind_parts(made, "sensor", &Robot::sensor);
  bind_parts(made, "body", &Robot::body);
  bind_parts(made, "axis", &Robot::axis);
  made.def_ro("full", &Robot::full)
      .def_prop_ro("axes", [](const Robot& robot) { return passive_axes(robot.mobility); })
      .def_prop_ro("parameter_count", [](const Robot& robot) { return parameter_count(robot); })
      .def("__bytes__",
           [](const Robot& robot) {
             static truepose_description description;  // 8 kB
             c::describe(robot, description);
             return nb::bytes(&description, sizeof description);
           })
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
      .def("rod_rows", &rod_rows)
      .def("shortfall",  // at home
           [](const Robot& robot, int i) {
             const Pose pose = placed(robot, to_pose(robot.mobility, robot.home));
             const Chain& of = robot.chain.at(i);
             return shortfall(of, pose.D + pose.R * of.pivot + of.anchor - of.base);
           })
      .def("drawn_parameters",
           [](const Robot& drawn) {
             std::vector<double> xi(parameters_of(drawn));
             require(drawn_parameters(drawn, xi.data()));
             return xi;
           })
      .def("with_parameters",
           [](const Robot& drawn, const std::vector<double>& xi) {
             Robot robot = drawn;
             if (xi.size() != parameters_of(drawn))
               throw nb::value_error("one value for each column");
             require(set_parameters(drawn, xi.data(), robot));
             static_cast<void>(note_assembly(robot));
             return robot;
           })
      .def("set_mechanism",
           [](Robot& robot, const std::vector<engine::Body>& bodies,
              const std::vector<engine::Closure>& closures, int described, int platform,
              int coordinates, const std::vector<double>& home) {
             engine::Mechanism& of = robot.mechanism = {};
             robot.finished = false;
             of.bodies = static_cast<int>(bodies.size());
             of.closures = static_cast<int>(closures.size());
             of.freedoms = static_cast<int>(home.size());
             of.described = described, of.platform = platform;
             of.motors = robot.motors, of.coordinates = coordinates;
             std::copy_n(bodies.begin(), std::min(bodies.size(), of.body.size()), of.body.begin());
             std::copy_n(closures.begin(), std::min(closures.size(), of.closure.size()),
                         of.closure.begin());
             std::copy_n(home.begin(), std::min(home.size(), of.home.size()), of.home.begin());
             if (!engine::check_parts(of)) return;
             engine::Position at;  // a leg without a start begins at the distance of its ends
             at.y = of.home;
             engine::place(of, at);
             for (int i = 0; i < of.closures; ++i)
               if (const int leg = of.closure[i].driven; leg >= 0 && of.home[leg] == 0)
                 of.home[leg] = (at.A[i] - at.B[i]).norm();
           })
      .def("check_mechanism",  // flaw, part, amount, gap of each closure (m), freedoms
           [](const Robot& robot) {
             engine::Position at;
             at.y = robot.mechanism.home;
             std::copy_n(robot.home.begin(), robot.mechanism.coordinates,
                         at.y.begin() + robot.mechanism.motors);
             const engine::Check found = engine::check(robot.mechanism, at);
             std::vector<double> gap;
             const bool closed =
                 found.flaw == engine::Flaw::none || found.flaw >= engine::Flaw::open;
             for (int i = 0; i < robot.mechanism.closures && closed; ++i)
               gap.push_back(engine::gap(robot.mechanism, at, i));
             return nb::make_tuple(
                 static_cast<int>(found.flaw), found.part, found.amount, gap,
                 std::vector(at.y.begin(), at.y.begin() + (closed ? robot.mechanism.freedoms : 0)));
           })
      .def("finish", [](Robot& robot) {
        Outcome outcome = finish(robot);
        if (outcome) outcome = finish_full(robot);
        return answered(outcome);
      });
}
}  // namespace

namespace {
/// numpy's type of a member: of its numbers, and their shape.
nb::tuple type_of(const c::Field& field) {
  const char* number = field.numbers == c::Numbers::real    ? "f8"
                       : field.numbers == c::Numbers::whole ? "i4"
                                                            : "?";
  nb::list shape;
  for (const int extent : {field.rows, field.columns})
    if (extent > 0) shape.append(extent);
  return nb::make_tuple(number, nb::tuple(shape));
}

/// A member of a struct as an array in its memory.
nb::object view(nb::handle self, const c::Field& field) {
  char* memory = nb::inst_ptr<char>(self) + field.offset;
  const nb::tuple type = type_of(field);
  return numpy("ndarray")(
      type[1], type[0],
      nb::steal(PyMemoryView_FromMemory(memory, field.count() * field.width(), PyBUF_WRITE)));
}
}  // namespace

nb::object get_member(nb::handle self, const c::Field& field) {
  return view(self, field).attr(field.rows ? "copy" : "item")();
}

void set_member(nb::handle self, const c::Field& field, nb::handle value) {
  const nb::object given = numpy("asarray")(value), all = view(self, field).attr("reshape")(-1);
  if ((field.rows > 0) != (nb::cast<int>(given.attr("ndim")) > 0)) throw nb::type_error(field.name);
  const nb::object numbers = given.attr("ravel")();
  const nb::slice first(nb::int_(0), numbers.attr("size"), nb::none());
  all.attr("fill")(0);
  numpy("copyto")(all[first], numbers, "same_kind");
}

std::array<std::string, 2> signatures(const c::Field& field) {
  const std::string type = field.rows                          ? "numpy.typing.NDArray"
                           : field.numbers == c::Numbers::real ? "float"
                                                               : "int";
  const std::string self = std::string("def ") + field.name + "(self";
  return {self + ") -> " + type, self + ", value: typing.Any) -> None"};
}

nb::object records(const void* data, std::size_t count, std::size_t size, const c::Table& table) {
  nb::list names, formats, offsets;
  for (const c::Field& field : table.fields) {
    names.append(field.name), formats.append(type_of(field)), offsets.append(field.offset);
  }
  nb::dict type;
  type["names"] = names, type["formats"] = formats, type["offsets"] = offsets;
  type["itemsize"] = size;
  return numpy("ndarray")(count, type, nb::bytes(data, count * size));
}

void enumeration(nb::module_& m, const char* name, const std::vector<const char*>& members) {
  const nb::object make = nb::module_::import_("enum").attr("IntEnum");
  nb::list values;
  for (const char* member : members) values.append(nb::make_tuple(member, nb::len(values)));
  m.attr(name) = make(name, values, nb::arg("module") = m.attr("__name__"));
}

void bind_structs(nb::module_& m) {
  bind_tables(m);
  structures<Chain, Sensor, Body, PassiveAxis, FaultMonitorSettings, MultirateSettings,
             SafetyLimits>(m);
  structure<GuardReport>(m, "GuardReport",
                         TRUEPOSE_MEMBERS(GuardReport, cause, part, brakes, follows));
  structure<engine::Body>(
      m, "MechanismBody",
      TRUEPOSE_MEMBERS(engine::Body, kind, parent, freedom, count, origin, axis, ratio, offset));
  structure<engine::Closure>(
      m, "MechanismClosure",
      TRUEPOSE_MEMBERS(engine::Closure, body_a, body_b, a, b, length, driven, motor, mode,
                       compliance, plane, normal, described, exchanged));
  structure<FullLevel>(m, "FullLevel", TRUEPOSE_MEMBERS(FullLevel, kind, rods, unknowns, excess));
  structure<ControlSettings>(m, "ControlSettings", c::table_of<ControlSettings>)
      .def("place_poles",
           [](ControlSettings& own, const Robot& robot, const Coordinates& x, double frequency,
              double damping) { return answered(place_poles(robot, x, frequency, damping, own)); });
  structure<Effects>(m, "Effects",
                     TRUEPOSE_MEMBERS(Effects, backlash, friction, arm_stiffness, rod_stiffness,
                                      arm_damping, ripple, phase, delayed));
  structure<Fault>(m, "Fault",
                   TRUEPOSE_MEMBERS(Fault, kind, reading, other, size, begin, end, count, frame));
  structure<Event>(m, "Event", TRUEPOSE_MEMBERS(Event, kind, begin, end, motor, size, force));
  bind_robot(m);
}
}  // namespace truepose::python
