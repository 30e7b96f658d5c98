#include "base/schema.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cmath>

namespace tachless::base {

std::string Range::text() const {
  const bool bounded_below = std::isfinite(min);
  const bool bounded_above = std::isfinite(max);
  if (bounded_below && bounded_above) {
    return fmt::format("{}in {}{:.16g}, {:.16g}{}", whole ? "whole and " : "", min_open ? '(' : '[',
                       min, max, max_open ? ')' : ']');
  }
  if (bounded_below) return fmt::format("{} {:.16g}", min_open ? ">" : ">=", min);
  if (bounded_above) return fmt::format("{} {:.16g}", max_open ? "<" : "<=", max);
  return "";
}

std::string allowed_text(Shape shape, const Range& range,
                         const std::vector<std::string_view>& choices, bool nullable) {
  const std::string limits = range.text();
  const std::string each = limits.empty() ? "" : ", each " + limits;
  const auto text = [&]() -> std::string {
    switch (shape) {
      case Shape::text:
        return "text";
      case Shape::choice:
        return fmt::format("one of {}", fmt::join(choices, ", "));
      case Shape::yes_no:
        return "true or false";
      case Shape::number:
        return "a finite number" + (limits.empty() ? "" : " " + limits);
      case Shape::whole:
        return "a whole number" + (limits.empty() ? "" : " " + limits);
      case Shape::matrix:
        return "a list with a list per joint, symmetric and positive definite, or its diagonal as "
               "a finite number > 0 or a list with one per joint";
      case Shape::joints:
        return "a finite number, or a list with one per joint" + each;
      case Shape::numbers:
        return "a list of finite numbers" + each;
      case Shape::joints_list:
        return "a list whose entries are a finite number or a list with one per joint" + each;
      case Shape::named_joints:
        return "a map whose values are a finite number or a list with one per joint" + each;
      case Shape::named_numbers:
        return "a map whose values are finite numbers" + each;
      case Shape::named_texts:
        return "a map whose values are text";
      case Shape::one_of:
        return fmt::format("a map with exactly one of {}", fmt::join(choices, ", "));
      case Shape::map:
        return "a map";
      case Shape::list_of_maps:
        return "a list of maps, at least one";
    }
    return "";
  };
  return text() + (nullable ? "; or null" : "");
}

}  // namespace tachless::base
