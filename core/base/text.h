#pragma once

#include <fmt/format.h>

#include <optional>
#include <string>
#include <string_view>
#include <vector>

/// Text helpers that fmt does not have: lists, numbers, tables, suggestions for a misspelt name. No
/// escaping for HTML (report/) and no YAML (experiment/).
namespace tachless::base {

/// The elements as fmt writes them, with `separator` between them: "link, motor".
template <class Range>
std::string joined(const Range& range, std::string_view separator = ", ") {
  return fmt::format("{}", fmt::join(range, separator));
}

/// The fewest significant digits that give `value` back when they are read: "0.1", "1e-06", "nan".
std::string shortest(double value);

/// A period for people, to four digits: "50 µs", "3.63 ms", "1.2 s".
std::string period_text(double seconds);

/// `text` on one line: line ends and other control characters become one space, together with the
/// white space around them; white space at both ends goes.
std::string one_line(std::string_view text);

/// The length in bytes of the UTF-8 character that begins `text`, which is not empty; 0 when it is
/// none.
std::size_t utf8_length(std::string_view text);

/// `text` with what would confuse a terminal or a JSON writer replaced by question marks: control
/// characters (of both sets, up to U+001F and U+007F to U+009F) and bytes that are not UTF-8. Every
/// line for people passes through it.
std::string printable(std::string_view text);

/// A file's name as one word for a shell: in '…' where it has to be, ./ before a leading dash.
std::string shell_word(std::string_view name);

/// `text` in parts, of which only the last, when they are so many, may hold the separator.
std::vector<std::string_view> split(std::string_view text, char separator,
                                    std::size_t most = std::string_view::npos);

/// The number that a text is, in C's form without a sign +; nothing where it is none.
std::optional<double> number_in(std::string_view text);

/// Whether `text` has only ASCII letters (capitals too where asked), digits and characters of
/// `extra`.
bool consists_of(std::string_view text, std::string_view extra, bool capitals = true);

/// A field of a CSV file (RFC 4180): in quotes where its characters ask for them. Text that a
/// spreadsheet would take for a formula, since it begins with = + - @ and is not a number, gets a '
/// before it.
std::string csv_field(std::string_view text);

/// Which candidate was probably meant by a misspelt or shortened `word`; nothing when none is
/// similar. Names may have parts, separated by dots. Similar is, best first:
/// - the same but for upper and lower case;
/// - `word` (two characters or more) is the beginning of the candidate, or its last parts:
///   "loria" for "loria_ortega_rigid", "kp" for "controller.gains.kp";
/// - at most a third of `word`'s characters (at least one; two from four characters on) have to be
///   inserted, deleted or replaced.
/// Of candidates that are equally similar the first one.
std::optional<std::string> nearest_of(std::string_view word,
                                      const std::vector<std::string_view>& candidates);

/// The same for any range of strings.
template <class Range>
std::optional<std::string> nearest(std::string_view word, const Range& candidates) {
  return nearest_of(word, {std::begin(candidates), std::end(candidates)});
}

/// Rows of cells as lines: two spaces before each cell, columns as wide as their widest cell.
/// @param alignment a letter for each column, l to the left or r to the right; the last one is for
/// all that follow. Not empty.
std::string table(const std::vector<std::vector<std::string>>& rows, std::string_view alignment);

}  // namespace tachless::base
