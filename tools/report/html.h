#pragma once

#include <fmt/format.h>

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace tachless::report {

/// A piece of HTML. Text becomes HTML by being escaped and in no other way, so that a text from a
/// log cannot act as markup. Does not check that elements are closed.
class Html {
 public:
  Html() = default;
  /// `text` as HTML text or attribute value. Bytes that are not UTF-8, and control characters but
  /// line end and tab, become the replacement character: texts from a log can be anything.
  explicit Html(std::string_view text);
  /// What is HTML already. Never for a text that comes from outside of the program.
  static Html from_markup(std::string markup);

  Html& operator+=(const Html& other);
  friend Html operator+(Html a, const Html& b) { return a += b; }
  [[nodiscard]] const std::string& markup() const { return markup_; }
  [[nodiscard]] bool empty() const { return markup_.empty(); }

 private:
  std::string markup_;
};

std::string inserted(const Html& value);
template <class Value>
std::string inserted(const Value& value) {
  return Html(fmt::to_string(value)).markup();
}

template <class /*Value*/>
using Inserted = std::string;

/// fmt::format for HTML: the pattern is markup, known at compile time; a value that is not Html is
/// text and gets escaped. html("<td>{}</td>", "a < b").
template <class... Values>
Html html(fmt::format_string<Inserted<Values>...> pattern, const Values&... values) {
  return Html::from_markup(fmt::format(pattern, inserted(values)...));
}

Html joined(const std::vector<Html>& parts, const Html& separator);

/// What `to_html` makes of each element, one after the other: cells of a row, rows of a table.
template <class Range, class ToHtml>
Html each(const Range& range, const ToHtml& to_html) {
  Html all;
  for (const auto& one : range) all += to_html(one);
  return all;
}

/// A number as people write it, from what fmt printed: minus sign, powers of ten.
Html number(std::string_view printed);

/// What to do when a study's file cannot be written.
inline constexpr std::string_view study_remedy = "name another directory with --out";

/// Writes the page of a study: title, `body`, the scenario's text; one file that needs nothing
/// else. @throw base::Failure(bad_usage) when it cannot be written
void write_study_page(const std::filesystem::path& path, const std::string& title, const Html& body,
                      const std::string& scenario);

}  // namespace tachless::report
