#pragma once

#include <cmath>
#include <nlohmann/json.hpp>
#include <string>

namespace tachless::base {

/// Returns `json` as text, for every JSON that is written. Bytes that are not UTF-8, such as a
/// file's name or a text from the bus, become U+FFFD, because the library would throw for them.
/// @param indent spaces per level; -1: all on one line
template <class Json>
std::string json_text(const Json& json, int indent = -1) {
  return json.dump(indent, ' ', false, Json::error_handler_t::replace);
}

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
