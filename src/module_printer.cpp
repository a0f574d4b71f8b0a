// Delta printers for Python: their answer as JSON, and their kinematics. No mathematics.
#include <nanobind/eigen/dense.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/string_view.h>

#include "arrays.hpp"
#include "truepose/printers/answer.hpp"

namespace truepose::python {
namespace {
using Points = Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor>;

std::string printer(std::string_view text, double arm, double probe_radius, int next,
                    const std::array<double, 8>& sigma) {
  printers::Request request{arm, probe_radius, next, {}};
  request.assumed.set(sigma.data());
  nb::gil_scoped_release release;
  return printers::answer(text, request);
}

Points each(const Points& rows, auto&& function) {
  Points result(rows.rows(), 3);
  for (Eigen::Index k = 0; k < rows.rows(); ++k)
    result.row(k) = function(printers::Vector3(rows.row(k).transpose())).transpose();
  return result;
}
}  // namespace

void bind_printer(nb::module_& m) {
  using namespace nb::literals;
  using printers::Delta, printers::Vector, printers::Vector3;
  m.def("printer", &printer, "text"_a, "arm"_a = 0.0, "probe_radius"_a = 0.0, "next"_a = 0,
        "sigma"_a = std::array<double, 8>{});
  nb::class_<Delta>(m, "Delta")
      .def(
          "__init__",
          [](Delta* of, bool rotary, const Vector3& step) { new (of) Delta{rotary, step}; },
          "rotary"_a, "step"_a)
      .def(
          "positions",
          [](const Delta& of, const Vector& p, const Points& steps) {
            return each(steps, [&](const Vector3& at) { return of.position(p, at); });
          },
          "p"_a, "steps"_a)
      .def(
          "steps",
          [](const Delta& of, const Vector& p, const Points& x) {
            return each(x, [&](const Vector3& at) { return of.steps(p, at); });
          },
          "p"_a, "x"_a)
      .def(
          "slopes",
          [](const Delta& of, const Vector& p, const Vector3& x) { return of.slopes(p, x); }, "p"_a,
          "x"_a);
}
}  // namespace truepose::python
