// Firmwares of delta printers that take M665 or EEPROM settings, by their words for one geometry.
//
// Towers are at 210°, 330° and 90°. The carriage of tower i at its endstop is sqrt(L² - R²) above
// the nozzle at height E_i in the centre: E_i = H + sign × endstop setting i. Sources: Marlin
// M665.cpp, delta.cpp; RepRapFirmware LinearDeltaKinematics.cpp, Grid.cpp; Smoothieware
// LinearDeltaSolution.cpp, Endstops.cpp (a negative trim is down), DeltaCalibrationStrategy.cpp,
// DeltaGridStrategy.cpp; Repetier Eeprom.cpp, Printer.cpp (homing), BedLeveling.cpp.
#pragma once

#include "truepose/printers/config.hpp"

namespace truepose::printers {
/// A firmware. Words have a command and a letter, or Repetier's number in the EEPROM ("EPR 881");
/// those of three towers, "M665 XYZ" or "EPR 901,905,909".
struct Dialect {
  const char *kind, *name;
  const char *rod, *radius, *height, *angle, *end, *trim;  ///< trim: of a rod's length; ""
  const char* probe;  ///< place of the probe beside the nozzle, x and y; "": not used
  const char* also;   ///< other words that are read, or have no influence on heights
  const char* zero;   ///< EEPROM settings that must be 0
  double sign;
  bool relative;        ///< heights have a common unknown shift
  const char* probing;  ///< how to probe

  bool eeprom() const { return rod[0] == 'E'; }
  /// Whether one of its words is this one.
  bool reads(const string& word) const;
};
constexpr Dialect kDialects[] = {
    {"marlin", "Marlin", "M665 L", "M665 R", "M665 H", "M665 XYZ", "M666 XYZ", "M665 ABC",
     "M851 XY", "M665 S,M206 Z,", "", -1, false,
     "M503, then G33 P3 V0, or G30 X… Y… at 13 points or more"},
    {"rrf", "RepRapFirmware", "M665 L", "M665 R", "M665 H", "M665 XYZ", "M666 XYZ", "", "G31 XY",
     "M666 A,M666 B,M665 B,", "", 1, false,
     "M665 and M666, then bed.g with 'G30 P0 X… Y… Z-99999' to the last one with S-1 and its 'bed "
     "probe heights', or heightmap.csv of G29"},
    {"smoothieware", "Smoothieware", "M665 L", "M665 R", "M665 Z", "M665 DEH", "M666 XYZ",
     "M665 IJK", "", "", "", -1, true, "M503, then G29.1, or G29 of the delta calibration"},
    {"repetier", "Repetier", "EPR 881", "EPR 885", "EPR 153", "EPR 901,905,909", "EPR 893,895,897",
     "EPR 933,937,941", "", "", "EPR 800,EPR 804,EPR 880,EPR 913,EPR 917,EPR 921,EPR zCorr,", 1,
     true, "M205, then G29, or G30 at 13 points or more"},
};
inline const Dialect& dialect_of(const string& kind) {
  return *std::find_if(std::begin(kDialects), std::end(kDialects),
                       [&](const Dialect& each) { return each.kind == kind; });
}

/// The word of tower i, or of axis i.
inline string word_of(string_view words, int i) {
  const size_t at = words.find(' ') + 1;
  const bool numbers = words.find(',') != words.npos;
  return string(words.substr(0, at)) +
         (numbers ? parts_of(words.substr(at), ',')[i] : string(1, words[at + i]));
}
inline bool Dialect::reads(const string& word) const {
  bool found = word == rod || word == radius || word == height ||
               string_view(also).find(word + ",") != string_view::npos;
  for (const char* words : {angle, end, trim, probe})
    for (int i = 0; *words && i < 2 + (words != probe); ++i)
      found = found || word_of(words, i) == word;
  return found;
}

/// Whether M666 sets a radius or a rod, as in MarlinKimbra, MK4duo and Rich Cattell's Marlin.
inline bool forked(string_view text) {
  for (const string_view line : lines_of(text))
    if (const size_t at = line.find("M666"); at != line.npos) {
      const string_view own = line.substr(at + 1, line.find_first_of(";#MG", at + 1) - at - 1);
      for (const char* letter : {" R", " D"})
        if (const size_t k = own.find(letter); k != own.npos && k + 2 < own.size())
          if (digit(own[k + 2])) return true;
    }
  return false;
}

/// The dialect of a text; null with the reason if none is known for its firmware, with a reason the
/// first if nothing tells.
inline const Dialect* spoken(string_view text, string& why) {
  constexpr char kKnown[] =
      ": the meaning of its letters is not known. Known are Klipper, Marlin, RepRapFirmware, "
      "Smoothieware and Repetier";
  constexpr pair<const char*, int> kSigns[] = {{"MK4duo", -1},
                                               {"MarlinKimbra", -1},
                                               {"EPR:", 3},
                                               {"Z-probe:", 3},
                                               {"arm_radius ", 2},
                                               {"PROBE: X", 2},
                                               {"G29.1", 2},
                                               {"center probe:", 2},
                                               {"Trim (mm)", 2},
                                               {"Calibrating Endstops", 2},
                                               {"delta radius ", 1},
                                               {"probe heights:", 1},
                                               {"ndstop adjustments ", 1},
                                               {"height map file", 1},
                                               {"G30 P", 1},
                                               {"M569 P", 1},
                                               {"M574 X", 1},
                                               {"M558 P", 1},
                                               {"echo:", 0},
                                               {"Bed X:", 0},
                                               {"G33", 0},
                                               {"M851", 0},
                                               {".Height:", 0}};
  constexpr char kName[] = "FIRMWARE_NAME:";
  if (const size_t at = text.find(kName); at != text.npos) {
    const string_view line = text.substr(at + sizeof kName - 1, 40);
    const string name(trimmed(line.substr(0, line.find_first_of("\r\n"))));
    for (const Dialect& each : kDialects)
      if (lower(name).starts_with(lower(each.name).substr(0, 6))) return &each;
    why = lower(name).starts_with("klipper")
              ? "a session of Klipper: give printer.cfg or klippy.log"
              : kName + one_line(name, 30) + kKnown;
    return nullptr;
  }
  if (forked(text)) {
    why = string("M666 R or D, of MK4duo or a fork of Marlin") + kKnown;
    return nullptr;
  }
  for (const auto& [sign, number] : kSigns)
    if (text.find(sign) != text.npos) {
      if (number < 0) why = string(sign) + ", of MK4duo or a fork of Marlin" + kKnown;
      return number < 0 ? nullptr : &kDialects[number];
    }
  // The homed height, in Smoothieware; a tower's angle elsewhere.
  for (size_t at = text.find("M665 Z"); at != text.npos; at = text.find("M665 Z", at + 1))
    if (std::atof(string(text.substr(at + 6, 12)).c_str()) > 20) return &kDialects[2];
  why = "unsure";
  return &kDialects[0];
}
}  // namespace truepose::printers
