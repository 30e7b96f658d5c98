#include "base/text.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <numeric>
#include <utility>

namespace tachless::base {
namespace {

/// Insertions, deletions and replacements from one to the other (Levenshtein).
std::size_t edit_distance(std::string_view from, std::string_view to) {
  std::vector<std::size_t> row(to.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t i = 0; i < from.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i + 1;
    for (std::size_t j = 0; j < to.size(); ++j) {
      const std::size_t replaced = diagonal + (from[i] == to[j] ? 0 : 1);
      diagonal = row[j + 1];
      row[j + 1] = std::min({replaced, row[j] + 1, row[j + 1] + 1});
    }
  }
  return row.back();
}

std::string lower(std::string_view text) {
  std::string result(text);
  for (char& c : result) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return result;
}

bool is_part(std::string_view word, std::string_view candidate) {
  if (word.size() < 2 || word.size() > candidate.size()) return false;
  if (candidate.starts_with(word)) return true;
  return candidate.ends_with(word) && candidate[candidate.size() - word.size() - 1] == '.';
}

/// How unlike the two are; nothing when too unlike for one to be meant by the other.
std::optional<std::size_t> unlikeness(const std::string& word, const std::string& candidate) {
  if (word == candidate) return 0;
  if (is_part(word, candidate)) return 1;
  const std::size_t largest = std::max<std::size_t>(word.size() < 4 ? 1 : 2, word.size() / 3);
  const std::size_t distance = edit_distance(word, candidate);
  if (distance > largest) return {};
  return 1 + distance;
}

/// Characters of UTF-8 text.
std::size_t length_of(std::string_view text) {
  return static_cast<std::size_t>(
      std::ranges::count_if(text, [](char c) { return (c & 0xc0) != 0x80; }));
}

}  // namespace

std::string shortest(double value) {
  std::array<char, 32> text;
  return {text.data(), std::to_chars(text.data(), text.data() + text.size(), value).ptr};
}

std::string period_text(double seconds) {
  if (seconds >= 0.99995) return fmt::format("{:.4g} s", seconds);
  if (seconds >= 0.99995e-3) return fmt::format("{:.4g} ms", 1e3 * seconds);
  return fmt::format("{:.4g} µs", 1e6 * seconds);
}

std::string one_line(std::string_view text) {
  std::string line;
  std::string gap;  // white space that may still be dropped
  bool ended = true;
  for (const char c : text) {
    const bool control = static_cast<unsigned char>(c) < ' ' || c == '\x7F';
    if (control || c == ' ') {
      ended = ended || control;
      gap += c;
      continue;
    }
    if (!line.empty()) line += ended && !gap.empty() ? " " : gap;
    line += c;
    gap.clear();
    ended = false;
  }
  return line;
}

std::size_t utf8_length(std::string_view text) {
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  const unsigned char lead = byte(0);
  const std::size_t length = lead < 0x80                   ? 1
                             : lead >= 0xc2 && lead < 0xe0 ? 2
                             : lead >= 0xe0 && lead < 0xf0 ? 3
                             : lead >= 0xf0 && lead < 0xf5 ? 4
                                                           : 0;
  if (length == 0 || length > text.size()) return 0;
  for (std::size_t i = 1; i < length; ++i) {
    if (byte(i) < 0x80 || byte(i) >= 0xc0) return 0;
  }
  if (length < 3) return length;
  const unsigned char second = byte(1);
  const bool bad = (lead == 0xe0 && second < 0xa0) || (lead == 0xed && second >= 0xa0) ||
                   (lead == 0xf0 && second < 0x90) || (lead == 0xf4 && second >= 0x90);
  return bad ? 0 : length;
}

namespace {
/// U+200E, U+200F, U+202A to U+202E, U+2066 to U+2069: what follows is shown in another order.
bool turns_direction(std::string_view character) {
  return (character >= "\xe2\x80\x8e" && character <= "\xe2\x80\x8f") ||
         (character >= "\xe2\x80\xaa" && character <= "\xe2\x80\xae") ||
         (character >= "\xe2\x81\xa6" && character <= "\xe2\x81\xa9");
}
}  // namespace

std::string printable(std::string_view text) {
  std::string result;
  while (!text.empty()) {
    const std::size_t length = utf8_length(text);
    const auto first = static_cast<unsigned char>(text[0]);
    const bool control =
        first < 0x20 || first == 0x7f ||
        (length == 2 && first == 0xc2 && static_cast<unsigned char>(text[1]) < 0xa0);
    if (length == 0 || control || turns_direction(text.substr(0, length))) {
      result += '?';
    } else {
      result += text.substr(0, length);
    }
    text.remove_prefix(std::max<std::size_t>(length, 1));
  }
  return result;
}

std::string shell_word(std::string_view name) {
  constexpr std::string_view special = " \"'\\`$&|;<>()[]{}*?!#~";
  const std::string word = (name.starts_with('-') ? "./" : "") + printable(name);
  if (!word.empty() && word.find_first_of(special) == std::string::npos) return word;
  std::string quoted = "'";
  for (const char c : word) quoted += c == '\'' ? "'\\''" : std::string(1, c);
  return quoted + "'";
}

std::vector<std::string_view> split(std::string_view text, char separator, std::size_t most) {
  std::vector<std::string_view> parts;
  while (parts.size() + 1 < most && text.find(separator) != std::string_view::npos) {
    parts.push_back(text.substr(0, text.find(separator)));
    text.remove_prefix(parts.back().size() + 1);
  }
  parts.push_back(text);
  return parts;
}

std::optional<double> number_in(std::string_view text) {
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size()) return {};
  return value;
}

bool consists_of(std::string_view text, std::string_view extra, bool capitals) {
  return std::all_of(text.begin(), text.end(), [&](char c) {
    return (c >= 'a' && c <= 'z') || (capitals && c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
           extra.find(c) != std::string_view::npos;
  });
}

std::string csv_field(std::string_view given) {
  double number = 0;
  const char* const end = given.data() + given.size();
  const bool is_number = std::from_chars(given.data(), end, number).ptr == end;
  const bool formula = !is_number && given.find_first_of("=+-@\t\r") == 0;
  std::string text = (formula ? "'" : "") + std::string(given);
  if (text.find_first_of(",#\"\r\n") == std::string::npos) return text;
  std::string result = "\"";
  for (const char c : text) result += c == '"' ? "\"\"" : std::string(1, c);
  return result + "\"";
}

std::optional<std::string> nearest_of(std::string_view word,
                                      const std::vector<std::string_view>& candidates) {
  const std::string wanted = lower(word);
  std::optional<std::string> nearest;
  std::pair<std::size_t, std::size_t> least;  // of equally similar ones the shorter
  for (const std::string_view candidate : candidates) {
    const auto unlike = unlikeness(wanted, lower(candidate));
    if (!unlike || (nearest && std::pair(*unlike, candidate.size()) >= least)) continue;
    least = {*unlike, candidate.size()};
    nearest = candidate;
  }
  return nearest;
}

std::string table(const std::vector<std::vector<std::string>>& rows, std::string_view alignment) {
  std::vector<std::size_t> widths;
  for (const auto& row : rows) {
    widths.resize(std::max(widths.size(), row.size()));
    for (std::size_t i = 0; i < row.size(); ++i) widths[i] = std::max(widths[i], length_of(row[i]));
  }
  std::string text;
  for (const auto& row : rows) {
    for (std::size_t i = 0; i < row.size(); ++i) {
      const std::string blank(widths[i] - length_of(row[i]), ' ');
      const bool left = alignment[std::min(i, alignment.size() - 1)] == 'l';
      text += "  " + (left ? row[i] + blank : blank + row[i]);
    }
    text.erase(text.find_last_not_of(' ') + 1);
    text += '\n';
  }
  return text;
}

}  // namespace tachless::base
