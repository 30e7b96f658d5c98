#pragma once

#include <fmt/format.h>

#include <optional>
#include <string>
#include <string_view>
#include <vector>

/// Text helpers that fmt does not have: lists, numbers, tables, suggestions for a misspelt name.
/// HTML is escaped in tools/report/, and YAML is written in core/scenario/.
namespace tachless::base {

/// Joins the elements, as fmt writes them, with `separator` between them: "link, motor".
template <class Range>
std::string joined(const Range& range, std::string_view separator = ", ") {
  return fmt::format("{}", fmt::join(range, separator));
}

/// Returns the fewest significant digits that read back as `value`: "0.1", "1e-06", "nan".
std::string shortest(double value);

/// Formats a period for people, to four digits: "50 µs", "3.63 ms", "1.2 s".
std::string period_text(double seconds);

/// Puts `text` on one line: replaces control characters and the white space around them by one
/// space, and removes white space at both ends.
std::string one_line(std::string_view text);

/// Returns the length in bytes of the UTF-8 character at the beginning of a non-empty `text`; 0 if
/// these bytes are no UTF-8.
std::size_t utf8_length(std::string_view text);

/// Replaces control characters (up to U+001F and U+007F to U+009F) and bytes that are not UTF-8 by
/// question marks. Terminals and JSON writers misread such bytes. Every line for people passes
/// through this function.
std::string printable(std::string_view text);

/// Quotes a file's name for a shell: in '…' if necessary, with ./ before a leading dash.
std::string shell_word(std::string_view name);

/// Splits `text` into at most `most` parts; the last one keeps any further separators.
std::vector<std::string_view> split(std::string_view text, char separator,
                                    std::size_t most = std::string_view::npos);

/// Parses a number in C's form without a sign +. Returns nothing if `text` is no number.
std::optional<double> number_in(std::string_view text);

/// Returns whether `text` has only ASCII letters (capitals too where asked), digits and characters
/// of `extra`.
bool consists_of(std::string_view text, std::string_view extra, bool capitals = true);

/// Formats a field of a CSV file (RFC 4180), in quotes if necessary. Puts a ' before text that a
/// spreadsheet would take for a formula: text that begins with = + - @ and is no number.
std::string csv_field(std::string_view text);

/// Returns the candidate that a misspelt or shortened `word` probably means; nothing if none is
/// similar. Names may have parts, separated by dots. These are similar, the best first:
/// - the same, except for upper and lower case;
/// - `word` (two characters or more) is the beginning of the candidate, or its last parts:
///   "loria" for "loria_ortega_rigid", "kp" for "controller.gains.kp";
/// - at most a third of `word`'s characters (at least one; two from four characters on) have to be
///   inserted, deleted or replaced.
/// Equally similar candidates: the first one wins.
std::optional<std::string> nearest_of(std::string_view word,
                                      const std::vector<std::string_view>& candidates);

/// Calls nearest_of for any range of strings.
template <class Range>
std::optional<std::string> nearest(std::string_view word, const Range& candidates) {
  return nearest_of(word, {std::begin(candidates), std::end(candidates)});
}

/// Formats rows of cells as lines: two spaces before each cell, columns as wide as their widest
/// cell.
/// @param alignment a letter for each column, l to the left or r to the right; the last one is for
/// all that follow. Not empty.
std::string table(const std::vector<std::vector<std::string>>& rows, std::string_view alignment);

}  // namespace tachless::base
