#pragma once

#include <fmt/format.h>

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace tachless::report {

/// A piece of HTML. Text becomes HTML only by being escaped, so text from a log cannot act as
/// markup. The class does not check that elements are closed.
class Html {
 public:
  Html() = default;
  /// Makes HTML text or an attribute value from `text`. Text from a log can contain any bytes. The
  /// replacement character takes the place of bytes that are not UTF-8, and of control characters
  /// other than line end and tab.
  explicit Html(std::string_view text);
  /// Returns `markup` as HTML, without escaping. Never use it for text from outside the program.
  static Html from_markup(std::string markup);

  Html& operator+=(const Html& other);
  friend Html operator+(Html a, const Html& b) { return a += b; }
  [[nodiscard]] const std::string& markup() const { return markup_; }
  [[nodiscard]] bool empty() const { return markup_.empty(); }

 private:
  std::string markup_;
};

/// Returns the markup that `html` puts in the place of a value.
std::string inserted(const Html& value);
template <class Value>
std::string inserted(const Value& value) {
  return Html(fmt::to_string(value)).markup();
}

/// Type that fmt formats in the place of a value of any type.
template <class /*Value*/>
using Inserted = std::string;

/// Formats HTML like fmt::format. The pattern is markup that is known at compile time. A value that
/// is not Html is text and is escaped. Example: html("<td>{}</td>", "a < b").
template <class... Values>
Html html(fmt::format_string<Inserted<Values>...> pattern, const Values&... values) {
  return Html::from_markup(fmt::format(pattern, inserted(values)...));
}

/// Returns the parts with `separator` between them.
Html joined(const std::vector<Html>& parts, const Html& separator);

/// Returns the concatenated results of `to_html` for all elements, for example the cells of a row
/// or the rows of a table.
template <class Range, class ToHtml>
Html each(const Range& range, const ToHtml& to_html) {
  Html all;
  for (const auto& one : range) all += to_html(one);
  return all;
}

/// Returns as HTML a number that fmt printed, with a typographic minus sign and a power of ten in
/// place of "e".
Html number(std::string_view printed);

/// Remedy in the message when a study's file cannot be written.
inline constexpr std::string_view study_remedy = "name another directory with --out";

/// Writes the page of a study: title, `body` and the scenario's text. The file needs no other file.
/// @throw base::Failure(bad_usage) when the file cannot be written
void write_study_page(const std::filesystem::path& path, const std::string& title, const Html& body,
                      const std::string& scenario);

}  // namespace tachless::report
