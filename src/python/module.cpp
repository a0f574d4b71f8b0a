// The Python module of the core. No mathematics.
#include "control/multirate.hpp"
#include "python/for_rows.hpp"
#include "simulation/faults.hpp"

NB_MODULE(_core, m) {
  namespace nb = nanobind;
  using namespace truepose;
  m.doc() = "truepose's real-time core. Use the truepose package; this is its engine.";
  nb::set_leak_warnings(false);  // an interpreter may end with robots alive
  const auto status = [](Status of) { return int(of); };
  for (const auto& [name, number] : {std::pair<const char*, int>{"max_motors", kMaxMotors},
                                     {"max_sensors", kMaxSensors},
                                     {"max_readings", kMaxReadings},
                                     {"max_bars", kMaxBars},
                                     {"max_axes", kMaxAxes},
                                     {"max_bodies", engine::kBodies},
                                     {"max_freedoms", engine::kFreedoms},
                                     {"max_closures", engine::kClosures},
                                     {"max_unknowns", kMaxUnknowns},
                                     {"most_late", kMostLate},
                                     {"oldest", kOldest},
                                     {"slowest", kSlowest},
                                     {"joint_limit", status(Status::joint_limit)},
                                     {"not_converged", status(Status::not_converged)},
                                     {"singular", status(Status::singular)},
                                     {"near_singular", status(Status::near_singular)},
                                     {"unreachable", status(Status::unreachable)}})
    m.attr(name) = number;
  m.def("describe", [](int status) { return describe(static_cast<Status>(status)); });
  m.def("stop", [](int more) { python::stopping += more; });
  python::bind_structs(m);
  python::bind_rows(m);
  python::bind_calibration(m);
  python::bind_control(m);
  python::bind_simulation(m);
}
