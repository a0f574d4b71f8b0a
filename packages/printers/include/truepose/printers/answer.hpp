// The assessment of a printer as JSON (packages/printers/docs/delta-printer.md describes its
// members).
#pragma once

#include "truepose/printers/assess.hpp"

namespace truepose::printers {
/// The changed values of Klipper's options.
inline vector<pair<Place, string>> changes_of(const Assessment& of) {
  vector<pair<Place, string>> changes;
  for (int k = 0; k < of.printer.delta.count(); ++k)
    if (const Option& each = of.printer.options[k]; of.prior.sigma[k] > 0 || each.angle())
      changes.push_back({each.place, format("%.6f", of.estimate.theta[k] / each.scale())});
  return changes;
}

/// The parameters of a firmware with one rod length: those of the estimate's distribution with
/// equal rods.
inline Vector with_equal_rods(const Estimate& of, const Delta& delta) {
  Matrix D = Matrix::Zero(2, of.theta.size());
  for (int i = 0; i < 2; ++i) D(i, delta.rod() + i) = 1, D(i, delta.rod() + i + 1) = -1;
  const Matrix gain = of.covariance * D.transpose();
  return of.theta - gain * (D * gain).ldlt().solve(D * of.theta);
}

/// Lines for printer.cfg, or commands for another firmware.
inline vector<string> lines_of(const Assessment& of) {
  const Config& config = of.config;
  if (config.kind != "klipper")
    return lines_to_send(
        config.own_rods ? of.estimate.theta : with_equal_rods(of.estimate, of.printer.delta),
        dialect_of(config.kind), config.own_rods, kMm / of.printer.delta.step[0]);
  vector<string> lines;
  string section;
  const auto changes = changes_of(of);
  for (const auto& [place, value] : Options(changes.begin(), changes.end())) {
    if (place.first != section) lines.push_back("[" + (section = place.first) + "]");
    lines.push_back(place.second + " = " + value);
  }
  return lines;
}

inline void write_fit(Json& json, const Assessment& of) {
  const Delta& delta = of.printer.delta;
  const int shown = delta.count() + (of.extended() ? 2 : 0);
  json.key("parameters").list(shown, [&](int k) {
    const Option& option = of.printer.options[k];
    const double scale = option.scale(), before = of.prior.sigma[k];
    const double sigma = sqrt(of.estimate.covariance(k, k));
    const bool own = k < delta.count(), free = before > 0;
    string said = free ? verdict_of(before, sigma) : "the axes' direction";
    if (!delta.rotary && k >= delta.rod() && k < delta.endstop() && !of.extended() &&
        said == "identified")
      said = "barely";  // heights alone never identify an arm: a longer one with a larger radius
                        // touches the same bed
    json.object("name", option.name, "unit", kSigma[option.kind].unit,  //
                "now", own ? of.printer.theta[k] / scale : kNaN,        //
                "klipper", own ? of.klipper[k] / scale : kNaN,          //
                "estimate", of.estimate.theta[k] / scale,               //
                "sigma", free ? sigma / scale : kNaN,                   //
                "prior", of.prior.mean[k] / scale,                      //
                "prior_sigma", free ? before / scale : kNaN, "verdict", said);
  });
  json.key("readings").list(of.printer.readings.size(), [&](int k) {
    const Reading& reading = of.printer.readings[k];
    json.object("name", reading.name, "distance", reading.distance, "probed", reading.probed,
                "value_mm", reading.value / kMm,             //
                "residual_now_mm", of.fits[0][k] / kMm,      //
                "residual_klipper_mm", of.fits[1][k] / kMm,  //
                "residual_mm", of.fits[2][k] / kMm,          //
                "left_out_mm", of.judged.off[k] / kMm,       //
                "detectable_mm", of.judged.shows[k] / kMm,   //
                "outlier", of.judged.wrong == k, "steps",
                vector<Vector3>(reading.at, reading.at + 1 + reading.distance));
  });
  json.key("rms_mm").object("now", rms(of.fits[0]) / kMm, "klipper", rms(of.fits[1]) / kMm,
                            "estimate", rms(of.fits[2]) / kMm);
  json.key("held_out_mm").open('{');
  for (const Residuals& way : of.held_out)
    json.key(way.name).object("heights", of.left(way.off) / kMm, "distances",
                              of.left(way.off, true) / kMm);
  const Noise& noise = of.judged.noise;
  json.close('}').key("noise").object("heights_mm", noise.sigma[0] / kMm,    //
                                      "heights_dof", noise.dof[0],           //
                                      "distances_mm", noise.sigma[1] / kMm,  //
                                      "distances_dof", noise.dof[1],         //
                                      "detectable_mm", of.judged.least / kMm);
  const Bed& now = of.before;
  const Bed& after = of.after;
  json.key("bed").open('{').key("points").list(after.points.size(), [&](size_t k) {
    Eigen::Vector<double, 5> row;
    row << after.points[k].head<2>(), now.offset[k][2], after.offset[k][2], after.sigma[k][2];
    json.value(row / kMm);
  });
  for (const auto& [name, bed] : {pair("now", &now), pair("after", &after)})
    json.key(name)
        .open('{')
        .members("rms_mm", bed->rms() / kMm)
        .key("error_mm")
        .list(bed->points.size(), [&](size_t k) { json.value(bed->error(k) / kMm); })
        .close('}');
  json.close('}').members("words", of.words, "verdict", of.verdict, "rely", of.rely, "theta",
                          of.estimate.theta, "lines", lines_of(of));
  json.key("covariance").list(of.estimate.theta.size(), [&](int k) {
    json.value(of.estimate.covariance.row(k));
  });
  if (of.config.kind == "klipper" && !of.config.log)
    json.members("config",
                 rewritten(of.config, changes_of(of), nominal_to_keep(of.prior, of.printer)));
}

/// The answer to a text: one JSON object. Lengths in mm and angles in degrees; steps, and without a
/// unit in the name theta, covariance, step and p: m, rad.
inline string answer(string_view text, const Request& request) {
  const Assessment of = assess(text, request);
  Json json;
  if (!of.config.error.empty()) return json.object("error", one_line(of.config.error, 2000)).text();
  const Delta& delta = of.printer.delta;
  const bool klipper = of.config.kind == "klipper";
  json.open('{').members("kind", of.config.kind, "firmware",
                         klipper ? "Klipper" : dialect_of(of.config.kind).name, "kinematics",
                         delta.rotary ? "rotary_delta" : "delta", "p",
                         of.printer.theta.head(delta.count()), "step", delta.step, "notes",
                         of.notes, "assumptions", of.assumptions);
  if (of.read) write_fit(json, of);
  json.key("plan").list(of.plan.size(), [&](size_t k) {
    const Planned& planned = of.plan[k];
    vector<Vector3> ends, steps;
    for (int end = 0; k > 0 && end <= planned.distance; ++end) {
      ends.push_back(planned.at[end] / kMm);
      steps.push_back(delta.steps(of.printer.theta, planned.at[end]));
    }
    json.object("reading",
                k == 0             ? ""
                : planned.distance ? "distance"
                                   : "height",  //
                "sigma_mm", planned.sigma / kMm, "ends_mm", ends, "steps", steps);
  });
  return json.close('}').text();
}
}  // namespace truepose::printers
