// Text of printers: numbers, formatting, and JSON, without exceptions, streams or locale.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace truepose::printers {
using std::sqrt, std::fabs, std::pow, std::sin, std::cos, std::min, std::max, std::isfinite,
    std::isnan;
using std::string, std::string_view, std::vector, std::map, std::pair, std::size_t, std::to_string;
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kMm = 1e-3, kDegree = 3.14159265358979323846 / 180;

/// Text of at most 4000 bytes by printf's format.
#if defined(__GNUC__)
__attribute__((format(printf, 1, 2)))
#endif
inline string format(const char* form, ...) {
  char text[4000];
  std::va_list values;
  va_start(values, form);
  const int size = std::vsnprintf(text, sizeof text, form, values);
  va_end(values);
  return size < 0 ? string() : string(text);
}

inline bool blank(char c) { return c == ' ' || (c >= '\t' && c <= '\r'); }
inline bool control(char c) { return static_cast<unsigned char>(c) < ' ' || c == 127; }
inline bool digit(char c) { return c >= '0' && c <= '9'; }
inline string lower(string_view text) {
  string result(text);
  for (char& c : result)
    if (c >= 'A' && c <= 'Z') c = char(c + 'a' - 'A');
  return result;
}
inline string_view trimmed(string_view text) {
  while (!text.empty() && blank(text.front())) text.remove_prefix(1);
  while (!text.empty() && blank(text.back())) text.remove_suffix(1);
  return text;
}
inline string replaced(string text, string_view from, string_view to) {
  for (size_t k = text.find(from); k != text.npos; k = text.find(from, k + to.size()))
    text.replace(k, from.size(), to);
  return text;
}

/// The finite number that a text is, NaN if it is none.
inline double number_of(string_view text) {
  const string word(trimmed(text));
  if (word.empty() || word.find_first_not_of("+-.0123456789eE") != word.npos) return kNaN;
  char* end = nullptr;
  const double value = std::strtod(word.c_str(), &end);
  return end == word.c_str() + word.size() && isfinite(value) ? value : kNaN;
}

/// A length in mm with two significant digits at least and no exponent; 0 below 0.0001.
inline string shown_mm(double value) {
  value /= kMm;
  return value < 1e-4 ? "0" : format(value < 9.95 ? "%#.2g" : "%.0f", value);
}

/// The lines of a text that end in LF, CR LF or CR.
inline vector<string_view> lines_of(string_view text) {
  vector<string_view> lines;
  for (size_t from = 0;;) {
    const size_t end = text.find_first_of("\r\n", from);
    lines.push_back(text.substr(from, end == text.npos ? end : end - from));
    if (end == text.npos) return lines;
    from = end + 1 + (text.substr(end, 2) == "\r\n");
  }
}

inline bool is_utf8(string_view text) {
  int more = 0;  // bytes of the character
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    const bool inside = (byte & 0xC0) == 0x80;
    if (inside != (more > 0) || byte == 0xC0 || byte == 0xC1 || byte > 0xF4) return false;
    more = inside ? more - 1 : (byte >= 0xC0) + (byte >= 0xE0) + (byte >= 0xF0);
  }
  return more == 0;
}

/// A text for one line of a message: control characters as escapes, about `most` bytes and "…".
inline string one_line(string_view text, size_t most = 60) {
  string line;
  for (const char c : text) {
    if (line.size() >= most && (c & 0xC0) != 0x80) return line + "…";
    line += control(c) ? format("\\x%02x", unsigned(c)) : string(1, c);
  }
  return line;
}

/// Writer of one JSON text; NaN and infinity are null.
class Json {
 public:
  Json& key(string_view name) {
    value(name).text_ += ':';
    return *this;
  }
  Json& open(char bracket) {
    comma().text_ += bracket;
    return *this;
  }
  Json& close(char bracket) {
    text_ += bracket;
    return *this;
  }
  /// A number, a truth value, a text in UTF-8, or a range of these.
  template <class Value>
  Json& value(const Value& of) {
    if constexpr (std::is_convertible_v<Value, string_view>) {
      comma().text_ += '"';
      for (const char c : string_view(of))  // '<': safe in a page's script
        text_ += control(c) || string_view("\"\\<").find(c) != string_view::npos
                     ? format("\\u%04x", unsigned(c))
                     : string(1, c);
      return close('"');
    } else if constexpr (std::is_same_v<Value, bool>) {
      comma().text_ += of ? "true" : "false";
    } else if constexpr (std::is_arithmetic_v<Value>) {
      comma().text_ += isfinite(of) ? format("%.17g", of) : "null";
    } else {
      list(size_t(of.size()), [&](size_t k) { value(of[k]); });
    }
    return *this;
  }
  /// An array of `count` elements, each written by f(k).
  Json& list(size_t count, auto&& f) {
    open('[');
    for (size_t k = 0; k < count; ++k) f(k);
    return close(']');
  }
  /// Members by name and value.
  Json& members() { return *this; }
  Json& members(string_view name, const auto& of, const auto&... more) {
    return key(name).value(of).members(more...);
  }
  Json& object(const auto&... members_) { return open('{').members(members_...).close('}'); }
  const string& text() const { return text_; }

 private:
  Json& comma() {
    if (!text_.empty() && string_view("[{:").find(text_.back()) == string_view::npos) text_ += ',';
    return *this;
  }
  string text_;
};
}  // namespace truepose::printers
