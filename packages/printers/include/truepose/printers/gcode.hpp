// Delta printers with Marlin or RepRapFirmware: a session's probing as Klipper's configuration, and
// lines to send.
//
// Both firmwares have the same geometry as Klipper (Marlin/src/module/delta.cpp,
// RepRapFirmware/src/Movement/Kinematics/LinearDeltaKinematics.cpp): towers at 210°, 330° and 90°
// plus the trims X, Y, Z of M665. The carriage of tower i at its endstop is sqrt(L² - R²) above the
// nozzle at height E_i in the centre:
//
//     RepRapFirmware: E_i = H + M666's adjustment i;  Marlin: E_i = H - M666's, which is 0 or less.
//
// A probed height z at (x, y) is the nozzle's coordinate, by these settings, where it touches the
// bed; by RepRapFirmware's tilt A, B in per cent its carriages are z + (A x + B y) / 100 high. A, B
// and C of Marlin's M665 are the rods' trims since 2.0.6; from 1.1.3 to 2.0.5 B is the radius of
// G33's points.
#pragma once

#include "truepose/printers/printer.hpp"
#include "truepose/printers/session.hpp"

namespace truepose::printers {
constexpr double kTrim = 10;  ///< mm: a longer B of Marlin's M665 is a radius, no trim of a rod

/// The first word of the settings that is not read, as a refusal; empty if there is none.
inline string unread(const Words& words, bool marlin) {
  bool known = true;  // whether this M665 is Marlin's, whose A, B, C are trims
  for (const auto& [word, values] : words) {
    const Command* of = command_of(word.substr(0, word.find(' ')));
    const char letter = word.back();
    const bool tower = letter == 'A' || letter == 'B' || letter == 'C';
    const bool trim = fabs(values[0]) <= kTrim;
    bool used = of->used.find(letter) != of->used.npos && values.size() == 1;
    if (tower && of->name == "M665")
      used = marlin ? trim || (letter == 'B' && values[0] > 0) : letter == 'B';
    if (tower && of->name == "M666") used = !marlin;
    if (word == "M665 L") used = values.size() == 1 || values.size() == 3;
    if (used || of->idle == "*" || of->idle.find(letter) != of->idle.npos ||
        (marlin && word == "M206 Z"))
      continue;
    known = known && of->name != "M665";
    if (values.size() != 1 || values[0] != of->neutral)
      return word + format(
                        "%g is not read: firmwares differ in it, or it is no setting of a delta "
                        "printer with three towers. Set it to %g, probe again",
                        values[0], of->neutral);
  }
  for (const char* word : {"M665 A", "M665 B", "M665 C"})
    if (const auto at = words.find(word);
        !known && marlin && at != words.end() && at->second[0] != 0)
      return word + format(
                        "%g: is no rod's trim where M665 has D to K or other letters that "
                        "Marlin's has not. Set it to 0, probe again",
                        at->second[0]);
  return {};
}

/// The value of a word of the settings.
inline double value_of(const Words& words, const string& word, double otherwise = 0) {
  const auto at = words.find(word);
  return at == words.end() ? otherwise : at->second[0];
}

/// The parameters that settings are, and the steps per mm. mm, degrees.
inline Vector parameters_of(const Words& words, bool marlin, Delta& delta) {
  Vector p(delta.count());
  p[0] = value_of(words, "M665 R");
  const auto L = words.find("M665 L");
  for (int i = 0; i < 3; ++i) {
    const char axis = "XYZ"[i];
    const double trim = marlin ? value_of(words, string("M665 ") + "ABC"[i]) : 0;
    p[delta.rod() + i] =
        L->second[L->second.size() == 3 ? size_t(i) : 0] + (fabs(trim) <= kTrim ? trim : 0);
    p[delta.angle() + i] = kTurns[0][i] + value_of(words, string("M665 ") + axis);
    p[delta.endstop() + i] =
        value_of(words, "M665 H") + (marlin ? -1 : 1) * value_of(words, string("M666 ") + axis);
    delta.step[i] = 1 / value_of(words, string("M92 ") + axis, 80);
  }
  return p;
}

/// Why a probing cannot be used, empty if it can; its points, x, y, z in mm, are set.
inline string points_of(const Probing& of, double probe_radius, vector<Vector3>& points) {
  for (const auto& [word, by] : of.lost)
    if (!word.starts_with("M92"))
      return by + " changed " + word +
             ", which was not printed before this probing: send M503 (RepRapFirmware: M665, M666), "
             "probe again";
  for (const auto& [word, name] : {pair("M665 L", "length of the rods"), pair("M665 R", "radius"),
                                   pair("M665 H", "homed height")})
    if (!of.words.contains(word))
      return format("M665 has no %c, the %s (M503 lists it)", word[5], name);
  const bool marlin = of.by != "G32";
  if (string said = unread(of.words, marlin); !said.empty()) return said;
  const string probe = marlin ? "M851 " : "G31 ";
  Vector3 offset(value_of(of.words, probe + "X"), value_of(of.words, probe + "Y"), 0);
  points = of.bed;
  for (size_t k = 0; k < of.g32.size(); ++k) {
    if (of.places.size() != of.g32.size() || !of.places.contains(int(k)))
      return format(
          "%d bed probe heights, but %d places 'G30 P… X… Y…': give bed.g and the answer to it",
          int(of.g32.size()), int(of.places.size()));
    points.emplace_back(of.places.at(int(k)).first, of.places.at(int(k)).second, of.g32[k]);
  }
  if (!of.g33.empty()) {
    const bool shifted = option_of(of.options, 'O', 0) != 0;
    const double P = option_of(of.options, 'P', 3), B = value_of(of.words, "M665 B");
    if (P > 3) return format("G33 P%g: its heights are means of several points; send G33 P3 V0", P);
    if (shifted && !of.words.contains("M851 X"))
      return "G33 O: the probe's offset (M851 X… Y…) is missing";
    if (!shifted) offset.setZero();  // the nozzle is at these points
    const bool by_B = B > kTrim && !shifted && option_of(of.options, 'R', 0) == 0;
    const double radius = probe_radius > 0 ? probe_radius : of.radius > 0 || !by_B ? of.radius : B;
    if (!(radius > 0))
      return "G33 of this firmware does not print where it probes: give the radius of its points "
             "(--probe-radius MM)";
    constexpr pair<const char*, double> kTurned[] = {{"x", 210}, {"xy", 270}, {"y", 330},
                                                     {"yz", 30}, {"z", 90},   {"zx", 150}};
    for (const auto& [name, z] : of.g33) {
      points.emplace_back(0, 0, z);
      for (const auto& [other, turn] : kTurned)
        if (name == other)
          points.back() += radius * Vector3(cos(turn * kDegree), sin(turn * kDegree), 0);
    }
  }
  for (Vector3& at : points) {
    at -= offset;
    if (!marlin)
      at[2] += (value_of(of.words, "M666 A") * at[0] + value_of(of.words, "M666 B") * at[1]) / 100;
  }
  return {};
}

/// A Marlin or RepRapFirmware session as Klipper's configuration; any other text as Klipper's own.
inline Config read(string_view text, double probe_radius) {
  const auto has = [&](string_view word) { return text.find(word) != text.npos; };
  if (!(has("M665") || has("delta radius")) || has("===== Config file ====="))
    return parse_config(text);
  const Session session(text);
  if (!session.seen) return parse_config(text);
  Config config;
  // The last probing of several points whose settings are known.
  const Probing* of = nullptr;
  const int count = int(session.probings.size());
  vector<Vector3> bed;
  string why;
  for (const int fewest : {kFewest, 1})
    for (int k = count; k-- > 0 && !of;) {
      const Probing& each = session.probings[k];
      if (each.points() < fewest) continue;
      const string said = points_of(each, probe_radius, bed);
      if (why.empty()) why = said;
      if (said.empty()) of = &each;
    }
  if (count == 0)
    why =
        "no probed heights: Marlin's answers to G33 P3 V0 or G30 X… Y…, or RepRapFirmware's "
        "bed.g with 'G30 P0 X… Y…' and its 'bed probe heights'";
  if (!of) config.fail(why);
  if (!of) return config;

  const bool marlin = of->by != "G32";
  Delta delta, later;
  const Vector p = parameters_of(of->words, marlin, delta);
  Words at_end = session.words;
  at_end.insert(of->words.begin(), of->words.end());
  bool known = unread(at_end, marlin).empty();
  for (const auto& [word, _] : of->words) known = known && !session.lost.contains(word);
  if (!known) at_end = of->words;
  const Vector now = parameters_of(at_end, marlin, later);
  for (const auto& [each, steps] : {pair(&p, &delta.step), pair(&now, &later.step)})
    if (const double radius = (*each)[0], rod = each->segment<3>(delta.rod()).minCoeff();
        !(rod > radius && radius > 0 && steps->minCoeff() > 0 && steps->allFinite()))
      config.fail(
          format("rods of %g mm must be longer than the radius, %g mm, and M92's steps "
                 "greater than 0",
                 rod, radius));
  if (bed.size() > kMostReadings)
    config.fail(format("%d probed heights: at most %d", int(bed.size()), kMostReadings));
  double reach = 0;
  Vector in_rad = p;
  in_rad.segment<3>(delta.angle()) *= kDegree;
  string lines =
      format("[printer]\nkinematics: delta\ndelta_radius: %.17g\n[%s]\n", now[0], kSection);
  for (size_t k = 0; k < bed.size(); ++k) {
    const Vector3 steps = delta.steps(in_rad, bed[k]);
    reach = max(reach, bed[k].head<2>().norm());
    if (!steps.allFinite())
      config.fail(format("no rod reaches (%g, %g) mm, a probed point", bed[k][0], bed[k][1]));
    lines += format("height%d: 0\nheight%d_pos: %.4f,%.4f,%.4f\n", int(k), int(k), steps[0],
                    steps[1], steps[2]);
  }
  if (!config.error.empty()) return config;
  const double radius = marlin ? 0 : value_of(of->words, "M665 B");
  lines += format("radius: %.17g\n", radius > 0 ? radius : reach);
  for (int i = 0; i < 3; ++i)
    lines += format(
        "[stepper_%c]\nstep_distance: %.17g\narm_length: %.17g\nangle: %.17g\n"
        "position_endstop: %.17g\n",
        "abc"[i], later.step[i], now[later.rod() + i], now[later.angle() + i],
        now[later.endstop() + i]);
  config = parse_config(lines);
  config.kind = marlin ? "marlin" : "rrf";
  config.own_rods = of->words.at("M665 L").size() == 3;
  for (const char* word : {"M665 A", "M665 B", "M665 C"})
    config.own_rods = config.own_rods || (marlin && of->words.contains(word) &&
                                          fabs(value_of(of->words, word)) <= kTrim);
  vector<string>& notes = config.notes;
  if (count > 1)
    notes.push_back(format(
        "%d probings: number %d is used, %d heights, with M665 R%g H%g, in force then%s%s", count,
        int(of - &session.probings[0]) + 1, int(bed.size()), value_of(of->words, "M665 R"),
        value_of(of->words, "M665 H"), why.empty() ? "" : "; not the last: ", why.c_str()));
  if (!known)
    notes.push_back(
        "the settings were changed after this probing and not printed: 'the file's parameters' "
        "are those in force while it was taken");
  else if (now != p)
    notes.push_back(
        "the settings were changed after this probing: 'the file's parameters' are the later ones");
  if (const double first = value_of(of->words, "M851 Z"), last = value_of(at_end, "M851 Z");
      first != last)
    notes.push_back(
        format("M851 Z was changed from %g to %g after this probing: its heights, and so the homed "
               "height, are by the former",
               first, last));
  if (!of->g33.empty() && !of->options.contains('P'))
    notes.push_back(
        "G33's P is not in the text: from P4 on its heights are means of "
        "several points; send G33 P3 V0");
  return config;
}

/// Parameters as lines to send to Marlin or RepRapFirmware; `own_rods`: a length for each tower.
inline vector<string> lines_to_send(const Vector& p, bool marlin, bool own_rods = true) {
  const Delta delta;
  const Vector3 arms = p.segment<3>(delta.rod()) / kMm, ends = p.segment<3>(delta.endstop()) / kMm;
  const Vector3 trims = p.segment<3>(delta.angle()) / kDegree - Vector3(kTurns[0]);
  const double mean = arms.mean(), height = marlin ? ends.minCoeff() : ends.mean();
  const Vector3 off = arms.array() - mean, own = (ends.array() - height) * (marlin ? -1 : 1) + 0.0;
  const string rods = !own_rods ? format("L%.3f", mean)
                      : marlin  ? format("L%.3f A%.3f B%.3f C%.3f", mean, off[0], off[1], off[2])
                                : format("L%.3f:%.3f:%.3f", arms[0], arms[1], arms[2]);
  return {"M665 " + rods +
              format(" R%.3f H%.3f X%.3f Y%.3f Z%.3f", p[0] / kMm, height, trims[0], trims[1],
                     trims[2]),
          format("M666 X%.3f Y%.3f Z%.3f", own[0], own[1], own[2]) + (marlin ? "" : " A0 B0"),
          "M500"};
}
}  // namespace truepose::printers
