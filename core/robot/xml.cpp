#include "robot/xml.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <sstream>
#include <string_view>
#include <tuple>

#include "base/file_text.h"
#include "base/text.h"

namespace tachless::robot {
namespace {

/// Returns the part of a text that TinyXML-2 could not read.
std::string_view unreadable(tinyxml2::XMLError error) {
  switch (error) {
    case tinyxml2::XML_ERROR_PARSING_ATTRIBUTE:
      return "an attribute cannot be read, or is there twice";
    case tinyxml2::XML_ERROR_PARSING_TEXT:
      return "a text cannot be read";
    case tinyxml2::XML_ERROR_PARSING_CDATA:
      return "a CDATA section has no end";
    case tinyxml2::XML_ERROR_PARSING_COMMENT:
      return "a comment has no end";
    case tinyxml2::XML_ERROR_PARSING_DECLARATION:
      return "an instruction <?…?> has no end, or is not at the beginning";
    case tinyxml2::XML_ERROR_PARSING_UNKNOWN:
      return "markup <!…> has no end";
    case tinyxml2::XML_ERROR_MISMATCHED_ELEMENT:
      return "an element is ended that was not begun last";
    default:
      return "an element cannot be read, or has no end";
  }
}

/// Finds markup that is no element. TinyXML-2 keeps it, and nothing here reads it.
class Check : public tinyxml2::XMLVisitor {
 public:
  bool Visit(const tinyxml2::XMLUnknown& markup) override {
    const bool allowed = markup.Parent()->ToDocument() != nullptr &&
                         std::string_view(markup.Value()).starts_with("DOCTYPE");
    if (!allowed) {
      problem =
          fmt::format("line {}: malformed XML: <!{:.60}> is no element; correct the file's XML",
                      markup.GetLineNum(), markup.Value());
    }
    return problem.empty();
  }

  std::string problem;
};

/// Returns the largest number of attributes in one element. TinyXML-2 compares each attribute with
/// all before it.
int most_attributes(std::string_view text) {
  int most = 0;
  const auto skip_past = [&](std::size_t from, std::string_view end) {
    const std::size_t found = text.find(end, from);
    return found == std::string_view::npos ? text.size() : found + end.size();
  };
  for (std::size_t at = text.find('<'); at < text.size(); at = text.find('<', at)) {
    if (text.substr(at).starts_with("<!--")) {
      at = skip_past(at, "-->");
      continue;
    }
    int attributes = 0;
    for (++at; at < text.size() && text[at] != '>'; ++at) {
      if (text[at] == '=') ++attributes;
      if (text[at] == '"' || text[at] == '\'') at = skip_past(at + 1, text.substr(at, 1)) - 1;
    }
    most = std::max(most, attributes);
  }
  return most;
}

}  // namespace

std::string parse_xml(const std::string& text, XmlDocument& document) {
  if (text.size() > base::max_text_bytes) {
    return fmt::format("{} bytes; allowed: at most {}", text.size(), base::max_text_bytes);
  }
  constexpr int max_attributes = 64;
  if (const int most = most_attributes(text); most > max_attributes) {
    return fmt::format("an element has {} attributes; allowed: at most {}", most, max_attributes);
  }
  const tinyxml2::XMLError error = document.Parse(text.data(), text.size());
  if (error == tinyxml2::XML_ERROR_EMPTY_DOCUMENT) return "it is empty; give a robot's XML";
  if (error == tinyxml2::XML_ELEMENT_DEPTH_EXCEEDED) {
    return fmt::format("line {}: elements nested too deep; allowed: {} levels",
                       document.ErrorLineNum(), TINYXML2_MAX_ELEMENT_DEPTH - 1);
  }
  const bool has_markup =
      text.find('<') != std::string::npos && text.find('\0') == std::string::npos;
  if (error == tinyxml2::XML_SUCCESS && document.RootElement() != nullptr) {
    Check check;
    document.Accept(&check);
    return check.problem;
  }
  if (!has_markup || error == tinyxml2::XML_SUCCESS)
    return "not XML text (UTF-8); give a robot's XML";
  return fmt::format("line {}: malformed XML: {}; correct the file's XML", document.ErrorLineNum(),
                     unreadable(error));
}

std::optional<double> finite_number(std::string_view word) {
  if (word.starts_with('+') && !word.starts_with("+-")) word.remove_prefix(1);
  const std::optional<double> value = base::number_in(word);
  if (value && !std::isfinite(*value)) return {};
  return value;
}

std::optional<std::vector<double>> finite_numbers(const std::string& text) {
  std::vector<double> found;
  std::istringstream words(text);
  for (std::string word; words >> word;) {
    const std::optional<double> value = finite_number(word);
    if (!value) return {};
    found.push_back(*value);
  }
  return found;
}

void add_inertia(XmlElement& inertial, const Eigen::Matrix3d& inertia) {
  XmlElement& written = add(inertial, "inertia");
  for (const auto& [name, row, column] : {std::tuple{"ixx", 0, 0},
                                          {"iyy", 1, 1},
                                          {"izz", 2, 2},
                                          {"ixy", 0, 1},
                                          {"ixz", 0, 2},
                                          {"iyz", 1, 2}}) {
    set(written, name, fmt::format("{}", inertia(row, column)));
  }
}

std::string xml_text(const XmlDocument& document, bool in_lines) {
  tinyxml2::XMLPrinter printer(nullptr, !in_lines);
  document.Accept(&printer);
  return printer.CStr();
}

}  // namespace tachless::robot
