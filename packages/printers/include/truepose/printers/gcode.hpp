// A session's probing as Klipper's configuration, and lines to send.
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
inline string unread(const Words& words, const Dialect& by) {
  bool known = true;  // whether this M665 is the dialect's, whose trims are trims
  const auto refused = [&](const string& word, double value, double neutral) {
    return format(
        "%s%s%g is not read: %s has it for no rod, radius, angle or endstop of three towers, or "
        "the text is another firmware's. Set it to %g, probe again",
        word.c_str(), by.eeprom() ? " " : "", value, by.name, neutral);
  };
  for (const auto& [word, values] : words) {
    if (word == by.rod && values.size() != 1 && values.size() != 3)
      return format("%s has %d rods: %s of three towers alone is read", word.c_str(),
                    int(values.size()), by.name);
    const Command* of = command_of(word.substr(0, word.find(' ')));
    const char letter = word.back();
    bool used = by.reads(word) && (values.size() == 1 || (word == by.rod && values.size() == 3));
    if (by.trim == string("M665 ABC") && word.starts_with("M665") && letter >= 'A' && letter <= 'C')
      used = used && (fabs(values[0]) <= kTrim || (letter == 'B' && values[0] > 0));
    for (int i = 0; i < 3 && !by.eeprom();
         ++i)  // no turn of a tower, but another firmware's length
      used = used && (word != word_of(by.angle, i) || fabs(values[0]) <= 2 * kTrim);
    if (string_view(by.zero).find(word + ",") != string_view::npos && values[0] != 0)
      return refused(word, values[0], 0);
    if (used || of->idle == "*" || of->idle.find(letter) != of->idle.npos) continue;
    known = known && of->name != "M665";
    if (values.size() != 1 || values[0] != of->neutral)
      return refused(word, values[0], of->neutral);
  }
  for (int i = 0; i < 3 && *by.trim; ++i)
    if (const auto at = words.find(word_of(by.trim, i));
        !known && at != words.end() && at->second[0] != 0)
      return refused(at->first, at->second[0], 0);
  return {};
}

/// The value of a word of the settings.
inline double value_of(const Words& words, const string& word, double otherwise = 0) {
  const auto at = words.find(word);
  return at == words.end() ? otherwise : at->second[0];
}

/// The parameters that settings are, and the steps per mm. mm, degrees.
inline Vector parameters_of(const Words& words, const Dialect& by, Delta& delta) {
  Vector p(delta.count());
  p[0] = value_of(words, by.radius);
  const auto L = words.find(by.rod);
  for (int i = 0; i < 3; ++i) {
    const double steps = value_of(words, by.eeprom() ? "EPR 11" : word_of("M92 XYZ", i), 80);
    const double trim = *by.trim ? value_of(words, word_of(by.trim, i)) : 0;
    const double turn = kTurns[0][i], angle = by.eeprom() ? 0 : turn;
    p[delta.rod() + i] =
        L->second[L->second.size() == 3 ? size_t(i) : 0] + (fabs(trim) <= kTrim ? trim : 0);
    p[delta.angle() + i] = angle + value_of(words, word_of(by.angle, i), turn - angle);
    p[delta.endstop() + i] = value_of(words, by.height) + by.sign *
                                                              value_of(words, word_of(by.end, i)) /
                                                              (by.eeprom() ? steps : 1);
    delta.step[i] = 1 / steps;
  }
  return p;
}

/// Why a probing cannot be used, empty if it can; its points, x, y, z in mm, are set.
inline string points_of(const Probing& of, const Dialect& dialect, double probe_radius,
                        vector<Vector3>& points) {
  for (const auto& [word, by] : of.lost)
    if (!word.starts_with("M92"))
      return by + " changed " + word + ", which was not printed before this probing: send " +
             dialect.probing;
  for (const auto& [word, name] :
       {pair(dialect.rod, "length of the rods"), pair(dialect.radius, "radius"),
        pair(dialect.height, "homed height")})
    if (!of.words.contains(word))
      return replaced(word, " ", " has no ") + ", the " + name + ": for " + dialect.name +
             " give " + dialect.probing +
             (&dialect == kDialects && word == dialect.height
                  ? ". Marlin before 1.1.3 has none: add 'M665 H…', Z after G28"
                  : "");
  if (string said = unread(of.words, dialect); !said.empty()) return said;
  Vector3 offset(0, 0, 0);
  for (int i = 0; i < 2 && *dialect.probe; ++i)
    offset[i] = value_of(of.words, word_of(dialect.probe, i));
  points = of.bed;
  for (size_t k = 0; k < of.g32.size(); ++k) {
    if (of.places.size() != of.g32.size() || !of.places.contains(int(k)))
      return format(
          "%d bed probe heights, but %d places 'G30 P… X… Y…': give bed.g and the answer to it",
          int(of.g32.size()), int(of.places.size()));
    const auto& [x, y] = of.places.at(int(k));
    if (!isnan(of.g32[k])) points.emplace_back(x, y, of.g32[k]);
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
  // A height without an origin: z = 0 in the middle.
  const auto middle = std::min_element(points.begin(), points.end(), [](auto& a, auto& b) {
    return a.template head<2>().norm() < b.template head<2>().norm();
  });
  if (dialect.relative && middle != points.end()) offset[2] = (*middle)[2];
  for (Vector3& at : points) {
    at -= offset;
    if (dialect.sign > 0 && !dialect.eeprom())
      at[2] += (value_of(of.words, "M666 A") * at[0] + value_of(of.words, "M666 B") * at[1]) / 100;
  }
  return {};
}

/// A session of another firmware as Klipper's configuration; any other text as Klipper's own.
inline Config read(string_view text, double probe_radius) {
  const auto has = [&](string_view word) { return text.find(word) != text.npos; };
  if (has("[printer]") || has("===== Config file =====")) return parse_config(text);
  Config config;
  string why;
  const Dialect* spoken_ = spoken(text, why);
  const Dialect& dialect = spoken_ ? *spoken_ : kDialects[0];
  const Session session(text, dialect);
  if (!session.seen && !forked(text)) return parse_config(text);
  if (!spoken_) config.fail(why);
  if (!spoken_) return config;
  const bool unsure = !why.empty();
  why.clear();
  // The last probing of several points whose settings are known.
  const Probing* of = nullptr;
  const int count = int(session.probings.size());
  vector<Vector3> bed;
  for (const int fewest : {kFewest, 1})
    for (int k = count; k-- > 0 && !of;) {
      const Probing& each = session.probings[k];
      if (each.points() < fewest) continue;
      const string said = points_of(each, dialect, probe_radius, bed);
      if (why.empty()) why = said;
      if (said.empty()) of = &each;
    }
  if (!of && why.empty()) {
    why = "no probed heights: ";
    for (const Dialect& each : kDialects)
      if (unsure || &each == &dialect)
        why += format("%sfor %s give %s", why.back() == ' ' ? "" : "; ", each.name, each.probing);
  }
  if (!of) config.fail(why);
  if (!of) return config;

  Delta delta, later;
  const Vector p = parameters_of(of->words, dialect, delta);
  Words at_end = session.words;
  at_end.insert(of->words.begin(), of->words.end());
  bool known = unread(at_end, dialect).empty();
  for (const auto& [word, _] : of->words) known = known && !session.lost.contains(word);
  if (!known) at_end = of->words;
  const Vector now = parameters_of(at_end, dialect, later);
  for (const auto& [each, steps] : {pair(&p, &delta.step), pair(&now, &later.step)})
    if (const double radius = (*each)[0], rod = each->segment<3>(delta.rod()).minCoeff();
        !(rod > radius && radius > 0 && steps->minCoeff() > 0 && steps->allFinite()))
      config.fail(
          format("rods of %g mm must be longer than the radius, %g mm, and the steps per mm "
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
  const double radius = dialect.reads("M666 A") ? value_of(of->words, "M665 B") : 0;
  lines += format("radius: %.17g\n", radius > 0 ? radius : max(reach, 1.0));
  for (int i = 0; i < 3; ++i)
    lines += format(
        "[stepper_%c]\nstep_distance: %.17g\narm_length: %.17g\nangle: %.17g\n"
        "position_endstop: %.17g\n",
        "abc"[i], later.step[i], now[later.rod() + i], now[later.angle() + i],
        now[later.endstop() + i]);
  config = parse_config(lines);
  config.kind = dialect.kind;
  config.own_rods = of->words.at(dialect.rod).size() == 3;
  for (int i = 0; i < 3 && *dialect.trim; ++i)
    if (const string word = word_of(dialect.trim, i); of->words.contains(word))
      config.own_rods = config.own_rods || fabs(value_of(of->words, word)) <= kTrim;
  for (const Vector3& at : bed)
    config.names.push_back(format("the height at X%.4g Y%.4g", at[0] + 0.0, at[1] + 0.0));
  vector<string>& notes = config.notes;
  if (count > 1)
    notes.push_back(format(
        "%d probings: number %d is used, %d heights, with %s%g %s%g, in force then%s%s", count,
        int(of - &session.probings[0]) + 1, int(bed.size()), dialect.radius,
        value_of(of->words, dialect.radius), dialect.height, value_of(of->words, dialect.height),
        why.empty() ? "" : "; not the last: ", why.c_str()));
  if (const string word = word_of(dialect.end, 0); !of->words.contains(word))
    notes.push_back(word + " is not in the text: endstops are taken as 0");
  if (dialect.relative)
    notes.push_back(
        "these heights have no origin: z = 0 is taken at the probed point nearest to the middle");
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

/// Parameters as lines to send; `own_rods`: a length for each tower; `steps`: per mm.
inline vector<string> lines_to_send(const Vector& p, const Dialect& to, bool own_rods = true,
                                    double steps = 80) {
  const Delta delta;
  const Vector3 arms = p.segment<3>(delta.rod()) / kMm, ends = p.segment<3>(delta.endstop()) / kMm;
  const Vector3 angles = p.segment<3>(delta.angle()) / kDegree;
  const bool tilts = to.reads("M666 A");  // RepRapFirmware: endstops about their mean
  const double mean = arms.mean(), height = tilts ? ends.mean() : ends.minCoeff();
  vector<string> lines;
  const auto add = [&](const string& word, const string& value) {
    const string command = word.substr(0, 4);
    if (to.eeprom())
      lines.push_back("M206 T" + string(value.find('.') == value.npos ? "1" : "3") + " P" +
                      word.substr(4) + (value.find('.') == value.npos ? " S" : " X") + value);
    else if (lines.empty() || !lines.back().starts_with(command))
      lines.push_back(word + value);
    else
      lines.back() += word.substr(4) + value;
  };
  const auto each = [&](const char* words, const Vector3& values, const char* form = "%.3f") {
    for (int i = 0; i < 3; ++i) add(word_of(words, i), format(form, values[i] + 0.0));
  };
  add(to.rod, own_rods && !*to.trim ? format("%.3f:%.3f:%.3f", arms[0], arms[1], arms[2])
                                    : format("%.3f", mean));
  if (own_rods && *to.trim) each(to.trim, arms.array() - mean);
  add(to.radius, format("%.3f", p[0] / kMm));
  add(to.height, format("%.3f", height));
  each(to.angle, to.eeprom() ? angles : angles - Vector3(kTurns[0]));
  each(to.end, (ends.array() - height) * to.sign * (to.eeprom() ? steps : 1),
       to.eeprom() ? "%.0f" : "%.3f");
  if (tilts) lines.back() += " A0 B0";
  lines.push_back("M500");
  return lines;
}
}  // namespace truepose::printers
