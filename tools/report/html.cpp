#include "report/html.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cstddef>
#include <utility>

#include "base/file_text.h"
#include "base/text.h"
#include "base/version.h"
#include "report/page_files.h"

namespace tachless::report {
namespace {

constexpr std::array<std::pair<char, const char*>, 5> entities = {
    {{'&', "&amp;"}, {'<', "&lt;"}, {'>', "&gt;"}, {'"', "&quot;"}, {'\'', "&#39;"}}};

}  // namespace

Html::Html(std::string_view text) {
  std::string& result = markup_;
  result.reserve(text.size());
  while (!text.empty()) {
    const std::size_t length = base::utf8_length(text);
    const char c = text.front();
    if (length == 0 || (static_cast<unsigned char>(c) < ' ' && c != '\n' && c != '\t') ||
        c == '\x7F') {
      result += "\uFFFD";
      text.remove_prefix(1);
      continue;
    }
    const auto* entity = std::ranges::find(entities, c, &std::pair<char, const char*>::first);
    if (entity != entities.end()) {
      result += entity->second;
    } else {
      result += text.substr(0, length);
    }
    text.remove_prefix(length);
  }
}

Html Html::from_markup(std::string markup) {
  Html result;
  result.markup_ = std::move(markup);
  return result;
}

Html& Html::operator+=(const Html& other) {
  markup_ += other.markup_;
  return *this;
}

std::string inserted(const Html& value) { return value.markup(); }

Html joined(const std::vector<Html>& parts, const Html& separator) {
  Html result;
  for (const Html& part : parts) {
    if (!result.empty()) result += separator;
    result += part;
  }
  return result;
}

Html number(std::string_view printed) {
  const std::size_t e = printed.find('e');
  const std::string_view mantissa = printed.substr(0, e);
  Html result(mantissa.starts_with('-') ? fmt::format("−{}", mantissa.substr(1))
                                        : std::string(mantissa));
  if (e == std::string_view::npos) return result;
  const bool negative = printed[e + 1] == '-';
  int exponent = 0;
  std::from_chars(printed.data() + e + 2, printed.data() + printed.size(), exponent);
  if (exponent != 0) result += html("·10<sup>{}{}</sup>", negative ? "−" : "", exponent);
  return result;
}

void write_study_page(const std::filesystem::path& path, const std::string& title, const Html& body,
                      const std::string& scenario) {
  const Html page = html(
      "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
      "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n"
      "<link rel=\"icon\" href=\"data:,\">\n<title>{0}</title>\n<style>\n{1}</style>\n</head>\n"
      "<body>\n<main>\n<h1>{0}</h1>\n{2}<details><summary>Scenario</summary><pre>{3}</pre>"
      "</details>\n<footer>Written by tachless {4}.</footer>\n</main>\n</body>\n</html>\n",
      title, Html::from_markup(page_css), body, scenario, base::version);
  base::UnfinishedFile(path, study_remedy).write(page.markup());
}

}  // namespace tachless::report
