// The Python module of the core. No mathematics.
#include "control/multirate.hpp"
#include "python/for_rows.hpp"
#include "simulation/faults.hpp"

NB_MODULE(_core, m) {
  namespace nb = nanobind;
  using namespace truepose;
  m.doc() = "truepose's real-time core. Use the truepose package; this is its engine.";
  nb::set_leak_warnings(false);  // an interpreter may end with robots alive
  m.attr("max_motors") = kMaxMotors;
  m.attr("max_sensors") = kMaxSensors;
  m.attr("max_readings") = kMaxReadings;
  m.attr("max_bars") = kMaxBars;
  m.attr("max_axes") = kMaxAxes;
  m.attr("max_bodies") = engine::kBodies;
  m.attr("max_freedoms") = engine::kFreedoms;
  m.attr("max_closures") = engine::kClosures;
  m.attr("max_unknowns") = kMaxUnknowns;
  m.attr("most_late") = kMostLate;
  m.attr("oldest") = kOldest;
  m.attr("slowest") = kSlowest;
  for (const auto& [name, status] : {std::pair{"joint_limit", Status::joint_limit},
                                     {"not_converged", Status::not_converged},
                                     {"singular", Status::singular},
                                     {"near_singular", Status::near_singular},
                                     {"unreachable", Status::unreachable}})
    m.attr(name) = static_cast<int>(status);
  m.def("describe", [](int status) { return describe(static_cast<Status>(status)); });
  m.def("stop", [](int more) { python::stopping += more; });
  python::bind_structs(m);
  python::bind_rows(m);
  python::bind_calibration(m);
  python::bind_control(m);
  python::bind_simulation(m);
  python::bind_safety(m);
}
