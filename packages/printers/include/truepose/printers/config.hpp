// Klipper's configuration: reader of printer.cfg and klippy.log, writer of printer.cfg.
//
// As in Klipper (klippy/configfile.py), a comment begins at any '#', or at a ';' at the start of a
// line or after a space. Lines that begin with "#*#" were written by SAVE_CONFIG; the file's own
// values take precedence over them. Included files are named, not read. A klippy.log has the whole
// configuration, includes too, at every start of Klipper; the last one counts.
#pragma once

#include <set>

#include "truepose/printers/text.hpp"

namespace truepose::printers {
constexpr size_t kMostBytes = 1000000;  ///< ten times the longest real configuration
constexpr double kLargest = 1e12;       ///< larger numbers would overflow in powers
constexpr string_view kSaved = "#*#";
constexpr string_view kSavedHeader =
    "#*# <---------------------- SAVE_CONFIG ---------------------->\n"
    "#*# DO NOT EDIT THIS BLOCK OR BELOW. The contents are auto-generated.\n"
    "#*#\n";

using Place = pair<string, string>;  ///< section and option
using Options = map<Place, string>;

/// Parts of an option between separators.
inline vector<string> parts_of(string_view text, char by) {
  vector<string> parts(1);
  for (const char c : text)
    if (c == by)
      parts.emplace_back();
    else
      parts.back() += c;
  return parts;
}

/// A configuration. The first error found by any function is kept; results after it are NaN.
struct Config {
  string kind = "klipper";  ///< or a dialect's
  bool log = false;         ///< of a klippy.log
  bool own_rods = true;     ///< the firmware has a rod length for each tower
  vector<string> lines;
  string end = "\n", mark;  ///< first line end; byte-order mark, or empty
  Options values, saved;    ///< as Klipper reads them; those of the saved block
  vector<Place> saved_order;
  map<Place, double> off;  ///< first number commented out in the file's own part
  string included;         ///< names of files
  vector<string> notes;
  vector<string> names;  ///< of the heights; empty: as in the file
  string error;

  void fail(const string& text) {
    if (error.empty()) error = text;
  }
  void fail(const Place& place, const string& text) {
    fail("[" + place.first + "] " + place.second +
         (has(place) ? " = " + one_line(values[place]) : "") + ": " + text);
  }
  bool has(const Place& place) const { return values.contains(place); }
  string word(const Place& place) {
    if (!has(place))
      fail(place,
           "is missing" + (included.empty() ? "" : "; it may be in " + included + ": not read"));
    return error.empty() ? values[place] : "";
  }
  double checked(const Place& place, string_view text, double above = -kLargest) {
    const double value = number_of(text);
    if (isnan(value)) fail(place, "must be a number");
    if (fabs(value) >= kLargest)
      fail(place, format("must be less than %g", kLargest));
    else if (value <= above)
      fail(place, format("must be greater than %g", above));
    return value;
  }
  double number(const Place& place, double above = -kLargest) {
    const string text = word(place);
    return error.empty() ? checked(place, text, above) : kNaN;
  }
};

/// A line's section, or its option in lower case and its value.
struct Line {
  string section, option;
  string_view value;

  explicit Line(string_view line) {
    const size_t close = line.rfind(']'), at = line.find_first_of("=:");
    if (line.starts_with('[') && close != line.npos) {
      section = trimmed(line.substr(1, close - 1));
    } else if (at != line.npos && at > 0 && !blank(line[0]) && line[0] != '#' && line[0] != ';') {
      option = lower(trimmed(line.substr(0, at)));
      value = line.substr(at + 1);
    }
  }
};

/// Read options by the rules of Python's configparser, which Klipper uses.
inline void parse_lines(Config& config, const vector<string_view>& lines, bool saved) {
  Options& into = saved ? config.saved : config.values;
  string section, *value = nullptr;
  size_t indent = 0;
  for (size_t k = 0; k < lines.size(); ++k) {
    const string_view line = lines[k];
    size_t end = 0;
    while (end < line.size() && line[end] != '#' &&
           !(line[end] == ';' && (end == 0 || blank(line[end - 1]))))
      ++end;
    const string_view text = trimmed(line.substr(0, end));
    if (text.empty()) {
      if (value) *value += '\n';
      continue;
    }
    const size_t own = size_t(text.data() - line.data());
    if (value && own > indent) {
      (*value += '\n') += text;
      continue;
    }
    indent = own;
    const Line of(text);
    if (!of.section.empty()) {
      section = of.section;
      value = nullptr;
      if (section.starts_with("include ")) {
        const string name(trimmed(string_view(section).substr(8)));
        config.included =
            one_line(config.included + (config.included.empty() ? "" : ", ") + name, 200);
      }
      continue;
    }
    const char* wrong = section.empty()     ? "before any [section]"
                        : of.option.empty() ? "neither a [section] nor 'option: value'"
                                            : nullptr;
    if (wrong)
      return config.fail(
          format("not a printer.cfg: line %d: %s: %s", int(k) + 1, one_line(text).c_str(), wrong));
    const Place place(section, of.option);
    if (saved && !into.contains(place)) config.saved_order.push_back(place);
    *(value = &into[place]) = trimmed(of.value);
  }
  for (auto& [_, of] : into)
    while (!of.empty() && blank(of.back())) of.pop_back();
}

/// The commented-out numbers, as SAVE_CONFIG leaves replaced values.
inline map<Place, double> commented_out(const auto& lines) {
  map<Place, double> found;
  string section;
  for (const string_view line : lines) {
    const bool out = line.starts_with('#');
    const Line of(out ? trimmed(line.substr(1)) : line);
    if (!out && !of.section.empty()) section = of.section;
    const double value = number_of(of.value.substr(0, of.value.find_first_of("#;")));
    if (out && !line.starts_with(kSaved) && !isnan(value))
      found.try_emplace({section, of.option}, value);
  }
  return found;
}

/// Read a printer.cfg or klippy.log.
inline Config parse_config(string_view text) {
  Config config;
  vector<string_view> lines = lines_of(text);
  const auto last = std::find(lines.rbegin(), lines.rend(), "===== Config file =====");
  config.log = last != lines.rend();
  if (config.log) {
    lines.erase(lines.begin(), last.base());
    const auto end = std::find_if(lines.begin(), lines.end(), [](string_view line) {
      return line.starts_with("=======================");
    });
    if (end == lines.end()) config.fail("ends within the configuration of Klipper's last start");
    lines.erase(end, lines.end());
    if (lines.empty()) lines.emplace_back();
    text = {lines[0].data(), size_t(lines.back().data() + lines.back().size() - lines[0].data())};
  }
  if (text.size() > kMostBytes) config.fail(format("more than %d bytes", int(kMostBytes)));
  if (!is_utf8(text) || text.find('\0') != text.npos) config.fail("not a text file (UTF-8)");
  if (!config.error.empty()) return config;
  if (lines[0].starts_with("\xEF\xBB\xBF")) {
    config.mark = text.substr(0, 3);
    lines[0].remove_prefix(3);
  }
  if (const size_t at = text.find_first_of("\r\n"); at != text.npos)
    config.end = text.substr(at, text.substr(at, 2) == "\r\n" ? 2 : 1);
  config.lines.assign(lines.begin(), lines.end());
  vector<string_view> block(lines.size());
  bool saved = false, begun = false;
  int gap = 0, broken = 0;  // number of a line in SAVE_CONFIG's block that it did not write
  for (size_t k = 0; k < lines.size(); ++k) {
    const bool own = !lines[k].starts_with(kSaved);
    if (saved && own && !gap) gap = int(k) + 1;
    if (!trimmed(lines[k]).empty()) broken = gap;
    saved = saved || !own;
    if (own) continue;
    std::swap(block[k], lines[k]);
    block[k].remove_prefix(min<size_t>(4, block[k].size()));
    begun = begun || block[k].starts_with('[');
    if (!begun) block[k] = {};
  }
  parse_lines(config, lines, false);
  parse_lines(config, block, true);
  for (const auto& [place, value] : config.saved)
    if (const auto [own, is_new] = config.values.insert({place, value}); own->second != value)
      config.notes.push_back("[" + place.first + "] " + place.second +
                             " stands twice: " + one_line(own->second) +
                             " counts, as in Klipper, and not the saved " + one_line(value));
  config.off = commented_out(config.lines);
  if (!config.included.empty())
    config.notes.push_back("included files are not read: " + config.included);
  if (broken)
    config.notes.push_back(
        format("line %d stands in what SAVE_CONFIG wrote and is no part of it: Klipper "
               "reads none of that block then",
               broken));
  return config;
}

/// The file's text with changed values, as SAVE_CONFIG would write it: the file's own values are
/// commented out and the saved block has the new ones. All else, comments and includes too, stays.
/// `nominal` numbers stay as comments, which Klipper ignores; Config::off reads the first one.
inline string rewritten(const Config& config, const vector<pair<Place, string>>& changes,
                        const vector<pair<Place, double>>& nominal) {
  Options all(changes.begin(), changes.end());
  vector<string> own;
  string section;
  bool changed = false;
  for (const string& line : config.lines) {
    if (line.starts_with(kSaved)) continue;
    const Line of(line);
    const bool goes_on = blank(line[0]) && !trimmed(line).empty();
    if (!of.section.empty()) section = of.section;
    if (!of.section.empty() || !of.option.empty()) changed = all.contains({section, of.option});
    own.push_back(changed && (goes_on || !of.option.empty()) ? "#" + line : line);
  }
  const map<Place, double> noted = commented_out(own);
  for (const auto& [place, value] : nominal)
    if (const auto is = noted.find(place); is == noted.end() || is->second != value) {
      const auto at = std::find_if(own.begin(), own.end(), [&](const string& line) {
        return Line(line).section == place.first;
      });
      if (at != own.end()) own.insert(at + 1, "#" + place.second + format(": %.10g", value));
    }
  while (!own.empty() && trimmed(own.back()).empty()) own.pop_back();
  string text;
  for (const string& line : own) (text += line) += '\n';
  (text += '\n') += kSavedHeader;
  vector<Place> order = config.saved_order;
  for (const auto& [place, _] : changes)
    if (!config.saved.contains(place)) order.push_back(place);
  all.insert(config.saved.begin(), config.saved.end());
  std::set<string> done;
  for (const auto& [name, _] : order)
    if (done.insert(name).second) {
      text += (done.size() > 1 ? "#*#\n#*# [" : "#*# [") + name + "]\n";
      for (const Place& place : order)
        if (place.first == name)
          text += "#*# " + place.second + " = " + replaced(all[place], "\n", "\n#*# \t") + "\n";
    }
  return config.mark + replaced(text, "\n", config.end);
}
}  // namespace truepose::printers
