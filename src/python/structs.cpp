// Structs of the core as Python classes, and their enumerations, by tables of their members.
#include "python/structs.hpp"

#include <string>

#include "mechanism/geometry.hpp"
#include "simulation/simulate.hpp"

namespace truepose::c {
using engine::Mechanism;
TRUEPOSE_MEMBERS(engine::Body, kind, parent, freedom, count, origin, axis, ratio, offset)
TRUEPOSE_MEMBERS(engine::Closure, body_a, body_b, a, b, length, driven, motor, mode, compliance,
                 plane, normal, described, exchanged)
TRUEPOSE_MEMBERS(Mechanism, bodies, closures, motors, coordinates, freedoms, platform, described,
                 home, body, closure)
TRUEPOSE_MEMBERS(FullLevel, kind, rods, unknowns, excess)
TRUEPOSE_MEMBERS(Effects, backlash, friction, arm_stiffness, rod_stiffness, arm_damping, ripple,
                 phase, delayed)
TRUEPOSE_MEMBERS(Fault, kind, reading, other, size, begin, end, count, frame)
TRUEPOSE_MEMBERS(Event, kind, begin, end, motor, size, force)
}  // namespace truepose::c

namespace truepose::python {
using namespace nb::literals;

namespace {
const char* text(Unit unit) {
  constexpr const char* kUnits[] = {"", "m", "rad", "reading"};
  return kUnits[int(unit)];
}

/// Names of a part's parameters, in ξ's order, with units.
nb::tuple named(const auto& table) {
  nb::list rows;
  for (const auto& row : table) rows.append(nb::make_tuple(row.name, text(row.unit)));
  return nb::tuple(rows);
}

/// An IntEnum whose members, a list or words, count from 0 in this order.
void enumeration(nb::module_& m, const char* name, const nb::object& members) {
  m.attr(name) = nb::module_::import_("enum").attr("IntEnum")(
      name, members, "module"_a = m.attr("__name__"), "start"_a = 0);
}
/// The core's tables of sensor kinds, laws, faults and ξ.
void bind_tables(nb::module_& m) {
  const nb::object row = nb::module_::import_("types").attr("SimpleNamespace");
  nb::dict sensors, laws, faults;
  nb::list causes;
  for (const SensorProperties& of : kSensorTable) {
    nb::list vectors;
    for (unsigned k = 0; k < kMountingVectors.size(); ++k)
      if (of.mounting & (1u << k)) vectors.append(kMountingVectors[k]);
    sensors[of.name] = row("of_chain"_a = of.of_chain, "shaft"_a = of.shaft,
                           "unit"_a = text(of.unit), "mounting"_a = vectors);
  }
  for (const LawProperties& of : kLawTable)
    laws[of.name] = row("law"_a = int(of.law), "weighs"_a = of.weighs, "sensed"_a = of.sensed);
  for (const FaultProperties& of : kFaultTable)
    faults[of.name] = row("kind"_a = int(of.kind), "size"_a = of.size, "lasts"_a = of.lasts,
                          "at_rest"_a = of.at_rest, "pair"_a = of.pair);
  for (const auto& of : kCauseTable) causes.append(of.name);
  m.attr("sensor_kinds") = sensors;
  m.attr("laws") = laws;
  m.attr("fault_kinds") = faults;
  m.attr("stop_causes") = nb::tuple(causes);
  m.attr("symptoms") =
      nb::make_tuple("", "missing", "out of range", "too fast", "stuck", "disagrees");
  m.attr("chain_parameters") = named(kChainTable);
  m.attr("sensor_parameters") = named(kSensorParameterTable);
  m.attr("axis_parameters") = named(kAxisTable);
  m.attr("closure_parameters") = named(kClosureTable);
  enumeration(m, "SensorKind", nb::list(sensors));
  for (const auto& [name, members] :
       {std::pair{"Mobility",
                  "planar_translation planar translation schoenflies spatial rotational_1 "
                  "rotational_2 rotational_3 mechanism_1 mechanism_2 mechanism_3"},
        {"JointKind", "slide shift hinge ball"},
        {"Flaw",
         "none too_many_bodies too_many_freedoms too_many_closures no_such_part circle no_length "
         "open unmoved idle dependent loose"},
        {"Actuator", "revolute prismatic telescopic"},
        {"BarJoint", "pivots four_bar"},
        {"Level", "ideal full"},
        {"FullKind", "undescribed same exists overconstrained loose elastic"},
        {"FeedForward", "none gravity full"},
        {"Gains", "diagonal inertia"},
        {"DisturbanceKind", "none payload friction contact"},
        {"Loss", "student squares"},
        {"LinkKind", "plane distance point"}})
    enumeration(m, name, nb::str(members));
}

/// Throws if the core failed. @throws nb::value_error
void require(Outcome outcome) {
  if (!outcome) throw nb::value_error(describe(outcome.status));
}
/// ξ of a finished robot; of another one, columns may be out of bounds.
std::size_t parameters_of(const Robot& robot) {
  require({robot.finished ? Status::ok : Status::unfinished});
  return std::size_t(parameter_count(robot));
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
      copy_first(result.cols(), rows[i], result[i]);
    else
      jx_row(closure.carried, closure.chain[i].v, closure.chain[i].lever, result[i]);
  return result;
}

void bind_robot(nb::module_& m) {
  structure<Robot>(m)
      .def_ro("full", &Robot::full)
      .def_rw("mechanism", &Robot::mechanism)
      .def_prop_ro("axes", [](const Robot& robot) { return passive_axes(robot.mobility); })
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
      .def("start_legs",  // one without a start begins at the distance of its ends
           [](Robot& robot) {
             engine::Mechanism& of = robot.mechanism;
             if (!engine::check_parts(of)) return;
             engine::Position at;
             at.y = of.home;
             engine::place(of, at);
             for (int i : range(of.closures))
               if (const int leg = of.closure[i].driven; leg >= 0 && of.home[leg] == 0)
                 of.home[leg] = (at.A[i] - at.B[i]).norm();
           })
      .def("check_mechanism",  // flaw, part, amount, gap of each closure (m) that stays open
           [](const Robot& robot) {
             const engine::Mechanism& of = robot.mechanism;
             engine::Position at;
             at.y = of.home;
             copy_first(of.coordinates, robot.home, at.y.begin() + of.motors);
             const engine::Check found = engine::check(of, at);
             std::vector<double> gap;
             for (int i = 0; i < of.closures && found.flaw == engine::Flaw::open; ++i)
               gap.push_back(engine::gap(of, at, i));
             return nb::make_tuple(int(found.flaw), found.part, found.amount, gap);
           })
      .def("finish", [](Robot& robot) {
        Outcome outcome = finish(robot);
        if (outcome) outcome = finish_full(robot);
        return answered(outcome);
      });
}
}  // namespace

nb::object type_of(const c::Table& table, std::size_t size) {
  nb::list names, formats, offsets;
  for (const c::Field& field : table.fields) {
    nb::list shape;
    for (const int extent : {field.rows, field.columns})
      if (extent > 0) shape.append(extent);
    constexpr const char* kNumbers[] = {"f8", "i4", "?"};
    const nb::object number = field.table ? type_of(*field.table, field.width)
                                          : nb::object(nb::str(kNumbers[int(field.numbers)]));
    names.append(field.name), offsets.append(field.offset);
    formats.append(nb::make_tuple(number, nb::tuple(shape)));
  }
  return numpy("dtype")(nb::module_::import_("builtins")
                            .attr("dict")("names"_a = names, "formats"_a = formats,
                                          "offsets"_a = offsets, "itemsize"_a = size));
}

namespace {
/// A member of a struct as an array in its memory.
nb::object view(nb::handle self, nb::handle type, const char* name) {
  if (!nb::cast<bool>(type.attr("names").attr("__contains__")(name)))
    throw nb::attribute_error(name);
  const nb::object memory = nb::steal(PyMemoryView_FromMemory(
      nb::inst_ptr<char>(self), nb::cast<int>(type.attr("itemsize")), PyBUF_WRITE));
  return numpy("ndarray")(nb::tuple(), type, memory)[name];
}
bool is_array(const nb::object& member) { return nb::cast<int>(member.attr("ndim")) > 0; }
}  // namespace

nb::object get_member(nb::handle self, nb::handle type, const char* name) {
  const nb::object member = view(self, type, name);
  if (!is_array(member)) return member.attr("item")();
  const bool records = !member.attr("dtype").attr("names").is_none();
  return member.attr("copy")().attr("view")(numpy(records ? "recarray" : "ndarray"));
}

void set_member(nb::handle self, nb::handle type, const char* name, nb::handle value) {
  const nb::object member = view(self, type, name), given = numpy("asarray")(value);
  if (is_array(member) != is_array(given)) throw nb::type_error(name);
  member.attr("fill")(0);
  const nb::slice first(nb::int_(0), given.attr("size"), nb::none());
  numpy("copyto")(member.attr("reshape")(-1)[first], given.attr("ravel")(), "same_kind");
}

void bind_structs(nb::module_& m) {
  bind_tables(m);
  structure<FaultMonitorSettings>(m);
  structure<MultirateSettings>(m);
  structure<SafetyLimits>(m);
  structure<GuardReport>(m);
  structure<engine::Mechanism>(m);
  structure<FullLevel>(m);
  structure<ControlSettings>(m).def(
      "place_poles",
      [](ControlSettings& own, const Robot& robot, const Coordinates& x, double frequency,
         double damping) { return answered(place_poles(robot, x, frequency, damping, own)); });
  structure<Effects>(m);
  structure<Fault>(m);
  structure<Event>(m);
  bind_robot(m);
}
}  // namespace truepose::python
