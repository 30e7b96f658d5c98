#pragma once

#include <cmath>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

/// JSON to text and back. The functions are instantiated once, in json_text.cpp: the library's own
/// writer and reader take longer to compile than most sources that use them.
namespace tachless::base {

/// Returns `json` as text, for every JSON that is written. Bytes that are not UTF-8, such as a
/// file's name or a text from the bus, become U+FFFD, because the library would throw for them.
/// @tparam Json nlohmann::json or nlohmann::ordered_json
/// @param indent spaces per level; -1: all on one line
template <class Json>
std::string json_text(const Json& json, int indent = -1);

/// Returns the JSON that `text` is.
/// @tparam Json nlohmann::json or nlohmann::ordered_json
/// @throw nlohmann::json::parse_error if it is none
template <class Json = nlohmann::json>
Json parse_json(std::string_view text);

/// Returns the JSON that `text` is, and null if it is none.
nlohmann::json json_or_null(std::string_view text);

/// Returns numbers as a JSON list. null stands for a number that is not finite.
template <class Json = nlohmann::ordered_json, class Numbers>
Json json_list(const Numbers& numbers) {
  Json list = Json::array();
  for (const double number : numbers) {
    list.push_back(std::isfinite(number) ? Json(number) : Json());
  }
  return list;
}

}  // namespace tachless::base
