#include "scenario/table.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "base/text.h"

namespace tachless::scenario {
namespace {

constexpr std::array<std::string_view, 7> time_names{
    "time", "time_s", "t_s", "t", "timestamp", "__time", "time_from_start"};

std::string_view trimmed(std::string_view text) {
  const std::size_t first = text.find_first_not_of(" \t\r");
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(" \t\r") + 1 - first);
}

/// A column's name in lower case, and the unit that stands in brackets behind it.
std::pair<std::string, std::string> name_and_unit(std::string_view text) {
  std::string lower(text);
  std::ranges::transform(lower, lower.begin(),
                         [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  const std::size_t open = lower.find_first_of("[(");
  if (open == std::string::npos || !(lower.ends_with(']') || lower.ends_with(')'))) {
    return {lower, ""};
  }
  return {std::string(trimmed(std::string_view(lower).substr(0, open))),
          lower.substr(open + 1, lower.size() - open - 2)};
}

bool is_seconds(std::string_view unit) {
  return unit.empty() || unit == "s" || unit == "sec" || unit == "seconds";
}

/// The number of a field; a sign + is allowed in front of a digit.
std::optional<double> number_of(std::string_view field) {
  if (field.starts_with('+') && !field.starts_with("+-")) field.remove_prefix(1);
  return base::number_in(field);
}

}  // namespace

Table::Table(std::string_view text, std::string source) : text_(text), source_(std::move(source)) {
  if (text_.starts_with("\xef\xbb\xbf")) at_ = 3;
  if (!read_fields()) refuse("no rows; allowed: a row for each time");
  if (fields_.back().empty()) fields_.pop_back();  // a separator at the end of each row
  width_ = fields_.size();
  if (width_ == 0 || !number_of(fields_.front())) {
    names_ = fields_;
  } else {
    pending_ = true;
    take_commented_names();
  }
}

void Table::refuse(const std::string& problem) const {
  throw std::invalid_argument(fmt::format("{}:{}: {}", source_, row_line_, problem));
}

/// Takes the comment line above the first row as names if it names the time and has a name for each
/// column.
void Table::take_commented_names() {
  if (comment_.empty()) return;
  const std::size_t first = comment_.find_first_not_of("#% \t");
  if (first == std::string_view::npos) return;
  const std::string_view text = comment_.substr(first);
  std::optional<Table> names;
  try {
    names.emplace(text, source_);
  } catch (const std::invalid_argument&) {
    return;  // prose
  }
  if (names->names_.size() != width_) return;
  const bool has_time = std::ranges::any_of(names->names_, [](const std::string& name) {
    return std::ranges::find(time_names, name_and_unit(name).first) != time_names.end();
  });
  if (has_time) names_ = std::move(names->names_);
}

bool Table::is_blank(char c) const { return c == ' ' || (c == '\t' && separator_ != '\t'); }

bool Table::at_end_of_line() const {
  return at_ >= text_.size() || text_[at_] == '\n' || text_.substr(at_).starts_with("\r\n");
}

bool Table::at_comment() const {
  if (text_[at_] != '#') return false;
  if (at_ == 0) return true;
  const char before = text_[at_ - 1];
  return before == ' ' || before == '\t' || before == '\n' || before == separator_;
}

void Table::skip_line() {
  const std::size_t end = text_.find('\n', at_);
  at_ = end == std::string_view::npos ? text_.size() : end + 1;
  ++line_;
}

void Table::choose_separator() {
  bool quoted = false;
  for (std::size_t i = at_; i < text_.size() && (quoted || text_[i] != '\n'); ++i) {
    const char c = text_[i];
    if (c == '"') quoted = !quoted;
    if (!quoted && (c == ',' || c == ';' || c == '\t')) {
      separator_ = c;
      return;
    }
    if (!quoted && c == '#' && i > at_) break;
  }
  separator_ = ' ';
}

/// Reads a field in quotes, in which two quotes are one.
void Table::read_quoted(std::string& field) {
  for (++at_; at_ < text_.size(); ++at_) {
    const char c = text_[at_];
    if (c == '\n') ++line_;
    if (c == '"') {
      if (!text_.substr(at_ + 1).starts_with('"')) {
        ++at_;
        return;
      }
      ++at_;
    }
    field += c;
  }
  refuse("a quotation mark is not closed");
}

void Table::read_field(std::string& field) {
  field.clear();
  while (!at_end_of_line() && is_blank(text_[at_])) ++at_;
  if (!at_end_of_line() && text_[at_] == '"') {
    read_quoted(field);
    while (!at_end_of_line() && separator_ != ' ' && is_blank(text_[at_])) ++at_;
    const bool ends = at_end_of_line() || text_[at_] == separator_ || at_comment();
    if (!ends) {
      refuse(fmt::format("text behind the quoted field \"{:.40}\"; put a separator between them",
                         field));
    }
    return;
  }
  const std::size_t begin = at_;
  while (!at_end_of_line() && text_[at_] != separator_ && !at_comment() &&
         !(separator_ == ' ' && is_blank(text_[at_]))) {
    ++at_;
  }
  field = trimmed(text_.substr(begin, at_ - begin));
}

bool Table::read_fields() {
  while (at_ < text_.size()) {
    row_line_ = line_;
    const std::size_t end = std::min(text_.find('\n', at_), text_.size());
    const std::string_view content = trimmed(text_.substr(at_, end - at_));
    if (content.empty() || content.front() == '#' || content.front() == '%') {
      comment_ = content;
      skip_line();
      continue;
    }
    if (!separator_) choose_separator();
    std::size_t count = 0;
    for (bool more = true; more; ++count) {
      if (count == fields_.size()) fields_.emplace_back();
      read_field(fields_[count]);
      if (separator_ == ' ') {
        while (!at_end_of_line() && is_blank(text_[at_])) ++at_;
        more = !at_end_of_line() && !at_comment();
      } else {
        more = !at_end_of_line() && text_[at_] == separator_;
        if (more) ++at_;
      }
    }
    fields_.resize(count);
    skip_line();
    return true;
  }
  return false;
}

void Table::require_width() {
  if (fields_.size() == width_ + 1 && fields_.back().empty()) fields_.pop_back();
  if (fields_.size() == width_) return;
  refuse(fmt::format("{} columns; allowed: {}, as in the first row", fields_.size(), width_));
}

bool Table::next() {
  if (pending_) {
    pending_ = false;
  } else {
    if (!read_fields()) return false;
    require_width();
  }
  if (++rows_ > max_table_rows) {
    refuse(fmt::format("more than {} rows; allowed: at most so many", max_table_rows));
  }
  return true;
}

std::string Table::label(std::size_t column) const {
  return names_.empty() ? fmt::format("{}", column + 1) : fmt::format("\"{}\"", names_[column]);
}

double Table::number(std::size_t column) const {
  const std::string& field = fields_[column];
  if (field.empty()) {
    refuse(fmt::format("column {} is empty; allowed: a finite number", label(column)));
  }
  const std::optional<double> x = number_of(field);
  if (!x || !std::isfinite(*x)) {
    refuse(fmt::format("\"{:.40}\" in column {} is not a finite number", field, label(column)));
  }
  return *x;
}

std::size_t Table::column(std::string_view name) const {
  const auto found = std::ranges::find(names_, name);
  if (found == names_.end()) {
    refuse(fmt::format("no column \"{}\"; there are {}", name, base::joined(names_)));
  }
  if (std::find(found + 1, names_.end(), name) != names_.end()) {
    refuse(fmt::format("two columns \"{}\"; rename one", name));
  }
  return static_cast<std::size_t>(found - names_.begin());
}

std::size_t Table::column_by_name_or_number(const std::string& given) const {
  const std::optional<double> number = base::number_in(given);
  if (!number || std::ranges::find(names_, given) != names_.end()) return column(given);
  if (!(*number >= 1) || *number != std::floor(*number) || *number > static_cast<double>(width_)) {
    refuse(fmt::format("column {} is asked for; allowed: 1 to {}, or a name", given, width_));
  }
  return static_cast<std::size_t>(*number) - 1;
}

std::size_t Table::time_column(const std::string& chosen, bool has_scale) const {
  if (!chosen.empty()) return column_by_name_or_number(chosen);
  if (names_.empty()) return 0;
  std::optional<std::size_t> found;
  for (std::size_t i = 0; i < names_.size(); ++i) {
    const auto [name, unit] = name_and_unit(names_[i]);
    if (std::ranges::find(time_names, name) == time_names.end()) continue;
    if (found) {
      refuse(fmt::format("both \"{}\" and \"{}\" may be the time; give time_column: {}",
                         names_[*found], names_[i], names_[i]));
    }
    if (!is_seconds(unit) && !has_scale) {
      refuse(fmt::format("\"{}\" is not in seconds; give time_scale, the seconds of its unit",
                         names_[i]));
    }
    found = i;
  }
  if (!found) {
    refuse(
        fmt::format("no column for the time ({}); there are {}; give time_column, or a first "
                    "row with the names of the columns, such as time,joint_1,joint_2",
                    base::joined(time_names), base::joined(names_)));
  }
  return *found;
}

}  // namespace tachless::scenario
