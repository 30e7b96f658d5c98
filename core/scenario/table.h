#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

/// Tables of numbers in text, row by row: motions (`reference: {file: …}`) and recordings
/// (`identify`). Fields follow RFC 4180. Nothing is repaired: a doubtful field is refused.
namespace tachless::scenario {

/// Most bytes and rows of a table that is read.
inline constexpr std::size_t max_table_bytes = 512'000'000;
inline constexpr std::size_t max_table_rows = 5'000'000;

/// Reader of a table. The first row that is no comment chooses the separator: the first comma,
/// semicolon or tab in it, or else blanks. A byte order mark is skipped. Lines that begin with # or
/// % are comments; a # after a blank or a separator begins a comment too.
class Table {
 public:
  /// Reads the first row.
  /// @param text has to outlive the table
  /// @param source the file's name
  /// @throw std::invalid_argument "source:line: …", as every function here
  Table(std::string_view text, std::string source);

  /// Returns the names of the columns; empty where the first row has numbers.
  [[nodiscard]] const std::vector<std::string>& names() const { return names_; }
  /// Returns the number of columns.
  [[nodiscard]] std::size_t width() const { return width_; }
  /// Returns the line of the row, from 1 on.
  [[nodiscard]] std::size_t line() const { return row_line_; }

  /// Returns the index of the only column of that name.
  [[nodiscard]] std::size_t column(std::string_view name) const;
  /// Returns the index of a column given by its name or by its number from 1 on.
  [[nodiscard]] std::size_t column_by_name_or_number(const std::string& given) const;
  /// Returns the index of the column for the time: `chosen`, or the only column with a usual name
  /// of the time. Usual names are time, time_s, t_s, t, timestamp, __time and time_from_start;
  /// capitals and a unit in brackets do not matter. In a table without names it is the first
  /// column.
  /// @param has_scale false: a unit other than seconds is refused
  [[nodiscard]] std::size_t time_column(const std::string& chosen, bool has_scale) const;

  /// Moves to the next row of numbers.
  /// @return false at the end
  bool next();
  /// Returns the number in a field of the row.
  /// @throw also for an empty field
  [[nodiscard]] double number(std::size_t column) const;

  /// Returns the text of a field of the row, without its quotes.
  [[nodiscard]] const std::string& text(std::size_t column) const { return fields_[column]; }

  [[noreturn]] void refuse(const std::string& problem) const;

 private:
  /// Splits the next row that is neither empty nor a comment into `fields_`.
  bool read_fields();
  void read_field(std::string& field);
  void read_quoted(std::string& field);
  void skip_line();
  [[nodiscard]] bool at_end_of_line() const;
  [[nodiscard]] bool at_comment() const;
  [[nodiscard]] bool is_blank(char c) const;
  void choose_separator();
  void take_commented_names();
  void require_width();
  [[nodiscard]] std::string label(std::size_t column) const;

  std::string_view text_;
  std::string source_;
  std::size_t at_ = 0, line_ = 1, row_line_ = 1, rows_ = 0, width_ = 0;
  std::optional<char> separator_;  ///< ' ' for runs of blanks
  bool pending_ = false;           ///< the first row has numbers and was not handed out yet
  std::string_view comment_;       ///< the comment line right above the first row
  std::vector<std::string> names_, fields_;
};

}  // namespace tachless::scenario
