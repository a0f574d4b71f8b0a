// The assessment of a printer as JSON (docs/delta-printer.md lists its members).
#pragma once

#include "truepose/printers/assess.hpp"

namespace truepose::printers {
/// Lines of the changed values for printer.cfg, or commands for Marlin and RepRapFirmware.
inline std::vector<std::pair<Place, std::string>> changes_of(const Assessment& of) {
  std::vector<std::pair<Place, std::string>> changes;
  const std::vector<Option> all = options(of.printer.delta.rotary);
  for (std::size_t k = 0; k < all.size(); ++k)
    if (of.prior.sigma[Eigen::Index(k)] > 0 || all[k].angle)
      changes.push_back({{all[k].section, all[k].option},
                         format("%.6f", of.estimate.theta[Eigen::Index(k)] / all[k].scale())});
  return changes;
}

/// The parameters of a firmware with one rod length: those of the estimate's distribution with
/// equal rods.
inline Vector with_equal_rods(const Estimate& of, const Delta& delta) {
  Matrix D = Matrix::Zero(2, of.theta.size());
  for (int i = 0; i < 2; ++i) D(i, delta.rod() + i) = 1, D(i, delta.rod() + i + 1) = -1;
  const Matrix gain = of.covariance * D.transpose();
  const Vector theta = of.theta - gain * (D * gain).ldlt().solve(D * of.theta);
  return theta.head(delta.count());
}

inline void write(Json& json, const char* name, const Bed& of) {
  json.key(name).open('{').member("rms_mm", Vector3(of.rms() / kMm));
  json.key("error_mm").open('[');
  for (std::size_t k = 0; k < of.points.size(); ++k) json.value(Vector3(of.error(k) / kMm));
  json.close(']').close('}');
}

inline void write_fit(Json& json, const Assessment& of) {
  const Delta& delta = of.printer.delta;
  const std::vector<Option> all = options(delta.rotary);
  json.key("parameters").open('[');
  for (int k = 0; k < delta.count() + 2; ++k) {
    const bool own = k < delta.count(), shrinkage = k == delta.count();
    if (!own && !of.extended()) break;
    const Option option =
        own ? all[std::size_t(k)] : Option{shrinkage ? "shrinkage" : "width", "", ""};
    const double scale = shrinkage ? 0.01 : option.scale();
    const double sigma = std::sqrt(of.estimate.covariance(k, k)), before = of.prior.sigma[k];
    std::string said = before > 0 ? verdict_of(before, sigma) : "the axes' direction";
    if (!delta.rotary && k >= delta.rod() && k < delta.rod() + 3 && !of.extended() &&
        said == "identified")
      said = "barely";  // heights alone never identify an arm: a longer one with a larger radius
                        // touches the same bed
    json.open('{')
        .member("name", option.name)
        .member("unit", shrinkage      ? "%"
                        : option.angle ? "°"
                                       : "mm");
    json.member("now", own ? of.printer.p[k] / scale : kNaN)
        .member("klipper", own ? of.klipper[k] / scale : kNaN);
    json.member("estimate", of.estimate.theta[k] / scale)
        .member("sigma", before > 0 ? sigma / scale : kNaN);
    json.member("prior", of.prior.mean[k] / scale)
        .member("prior_sigma", before > 0 ? before / scale : kNaN);
    json.member("verdict", said).close('}');
  }
  json.close(']').key("readings").open('[');
  for (std::size_t k = 0; k < of.printer.readings.size(); ++k) {
    const Reading& reading = of.printer.readings[k];
    const auto at = Eigen::Index(k);
    json.open('{')
        .member("name", reading.name)
        .member("distance", reading.distance)
        .member("probed", reading.probed);
    json.member("value_mm", reading.value / kMm)
        .member("residual_now_mm", of.fits[0].off[at] / kMm);
    json.member("residual_klipper_mm", of.fits[1].off[at] / kMm)
        .member("residual_mm", of.fits[2].off[at] / kMm);
    json.member("left_out_mm", of.judged.off[at] / kMm)
        .member("left_out_sigma_mm", of.judged.scale[at] / kMm);
    json.member("detectable_mm", of.judged.shows[at] / kMm);
    json.member("outlier", of.judged.wrong == int(k)).key("steps").open('[').value(reading.at[0]);
    if (reading.distance) json.value(reading.at[1]);
    json.close(']').close('}');
  }
  json.close(']').key("rms_mm").open('{');
  const char* const names[] = {"now", "klipper", "estimate"};
  for (std::size_t k = 0; k < 3; ++k) json.member(names[k], rms(of.fits[k].off) / kMm);
  json.close('}').key("held_out_mm").open('{');
  for (const Residuals& way : of.held_out) {
    json.key(way.name).open('{').member("heights", rms_finite(of.of_heights(way)) / kMm);
    json.member("distances", rms_finite(of.of_distances(way)) / kMm)
        .member("off", Vector(way.off / kMm))
        .close('}');
  }
  json.close('}').key("noise").open('{').member("heights_mm", of.judged.noise.sigma[0] / kMm);
  json.member("heights_dof", of.judged.noise.dof[0])
      .member("distances_mm", of.judged.noise.sigma[1] / kMm);
  json.member("distances_dof", of.judged.noise.dof[1])
      .member("detectable_mm", of.judged.least / kMm)
      .close('}');
  json.key("bed").open('{').key("points").open('[');
  for (std::size_t k = 0; k < of.after.points.size(); ++k) {
    const Vector3& at = of.after.points[k];
    double now = kNaN;
    for (std::size_t j = 0; j < of.before.points.size(); ++j)
      if (of.before.points[j] == at) now = of.before.offset[j][2];
    json.value(std::array{at[0] / kMm, at[1] / kMm, now / kMm, of.after.offset[k][2] / kMm,
                          of.after.sigma[k][2] / kMm});
  }
  json.close(']');
  write(json, "now", of.before);
  write(json, "after", of.after);
  json.close('}').member("words", of.words).member("verdict", of.verdict).member("rely", of.rely);
  json.member("theta", of.estimate.theta).key("covariance").open('[');
  for (Eigen::Index k = 0; k < of.estimate.theta.size(); ++k)
    json.value(Vector(of.estimate.covariance.row(k)));
  json.close(']');
}

/// The answer to a text: one JSON object. Lengths in mm and angles in degrees; steps, and without a
/// unit in the name theta, covariance, step and p: m, rad.
inline std::string answer(std::string_view text, const Request& request) {
  const Assessment of = assess(text, request);
  Json json;
  json.open('{');
  if (!of.config.error.empty())
    return json.member("error", one_line(of.config.error, 2000)).close('}').text();
  const bool klipper = of.config.kind == "klipper";
  json.member("kind", of.config.kind).member("log", of.config.log);
  json.member("kinematics", of.printer.delta.rotary ? "rotary_delta" : "delta");
  json.member("radius_mm", of.printer.radius / kMm)
      .member("p", of.printer.p)
      .member("step", of.printer.delta.step);
  json.member("arm_mm", of.prior.arm / kMm);
  if (of.read) {
    write_fit(json, of);
    std::vector<std::string> lines;
    if (!klipper)
      lines = lines_to_send(
          of.config.own_rods ? of.estimate.p() : with_equal_rods(of.estimate, of.printer.delta),
          of.config.kind == "marlin", of.config.own_rods);
    else
      for (const char* section : {"printer", "stepper_a", "stepper_b", "stepper_c"}) {
        lines.push_back("[" + std::string(section) + "]");
        for (const auto& [place, value] : changes_of(of))
          if (place.first == section) lines.push_back(place.second + " = " + value);
      }
    json.member("lines", lines);
    if (klipper && !of.config.log)
      json.member("config", rewritten(of.config, changes_of(of),
                                      nominal_to_keep(of.prior, of.printer.delta)));
  }
  json.member("notes", of.notes).member("assumptions", of.assumptions).key("next").open('[');
  for (std::size_t k = 1; k < of.plan.size(); ++k)
    if (!of.plan[k].distance)
      json.value(std::array{of.plan[k].at[0][0] / kMm, of.plan[k].at[0][1] / kMm});
  json.close(']').key("plan").open('[');
  for (std::size_t k = 0; k < of.plan.size(); ++k) {
    const Planned& planned = of.plan[k];
    json.open('{').member("reading", k == 0 ? "" : planned.distance ? "distance" : "height");
    json.member("sigma_mm", Vector3(planned.sigma / kMm)).key("ends_mm").open('[');
    for (int end = 0; k > 0 && end <= planned.distance; ++end)
      json.value(Vector3(planned.at[end] / kMm));
    json.close(']').key("steps").open('[');
    for (int end = 0; k > 0 && end <= planned.distance; ++end)
      json.value(of.printer.delta.steps(of.printer.p, planned.at[end]));
    json.close(']').close('}');
  }
  return json.close(']').close('}').text();
}
}  // namespace truepose::printers
