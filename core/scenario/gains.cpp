#include "scenario/gains.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "base/text.h"

namespace tachless::scenario {
namespace {

using base::split;

bool is_name(std::string_view text) {
  return !text.empty() && std::ranges::all_of(text, [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '_';
  });
}

std::optional<Vector> read_numbers(std::string_view text, int num_joints) {
  std::vector<double> values;
  for (const std::string_view number : split(text, ',')) {
    const std::optional<double> value = base::number_in(number);
    if (!value || !std::isfinite(*value)) return {};
    values.push_back(*value);
  }
  if (values.size() == 1) return Vector::Constant(num_joints, values.front());
  const auto n = static_cast<std::size_t>(num_joints);
  const bool matrix = values.size() == n * n && n * n <= max_joints;
  if (values.size() != n && !matrix) return {};
  return Eigen::Map<const Eigen::VectorXd>(values.data(), static_cast<Eigen::Index>(values.size()));
}

}  // namespace

std::string gains_text(const Gains& gains) {
  std::string text;
  for (const auto& [name, value] : gains) {
    const bool alike = value.size() > 0 && (value.array() == value[0]).all();
    text +=
        fmt::format("{}{}={}", text.empty() ? "" : ";", name,
                    alike ? fmt::format("{}", value[0]) : fmt::format("{}", fmt::join(value, ",")));
  }
  return text;
}

std::optional<Gains> read_gains(std::string_view text, int num_joints) {
  Gains gains;
  for (const std::string_view gain : split(text, ';')) {
    const auto parts = split(gain, '=');
    if (parts.size() != 2 || !is_name(parts[0])) return {};
    const auto values = read_numbers(parts[1], num_joints);
    if (!values || !gains.emplace(parts[0], *values).second) return {};
  }
  return gains;
}

}  // namespace tachless::scenario
