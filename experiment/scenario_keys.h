#pragma once

#include <limits>
#include <string>
#include <string_view>
#include <vector>

/// Every key of a scenario, declared once: the reader takes type, default and range from here, and
/// so does the table of docs/scenario.md.
namespace tachless::experiment {

struct Range {
  double min = -std::numeric_limits<double>::infinity();
  double max = std::numeric_limits<double>::infinity();
  bool min_open = false;  ///< min itself is not allowed
  bool max_open = false;

  [[nodiscard]] bool contains(double value) const;
  /// "in (0, 1]", ">= 0", "> 0"; empty when every finite number is allowed.
  [[nodiscard]] std::string text() const;
};

enum class Shape {
  text,
  choice,
  number,
  whole,          ///< number without fraction
  joints,         ///< one number for every joint, or a list with one number per joint
  numbers,        ///< list of numbers
  joints_list,    ///< list of `joints`
  choice_or_map,  ///< a choice, or a map of the same name
  list_of_maps,
};

struct Key {
  /// "loop.period_s"; entries of a list go without index, "<name>" stands for the user's choice.
  std::string_view path;
  Shape shape = Shape::number;
  std::string_view unit;
  /// YAML; empty = required; in parentheses = not a value but what happens.
  std::string_view fallback;
  Range range;
  std::vector<std::string_view> choices;  ///< in the order of the enum
  bool nullable = false;
  std::string_view meaning;
};

const std::vector<Key>& scenario_keys();

/// The key of `path`: "terms[2].phase_rad" finds "terms.phase_rad", "gains.kp" "gains.<name>".
/// @throw std::logic_error when it was never declared.
const Key& scenario_key(std::string_view path);

/// True for a declared key and for the maps on the way to one.
bool is_scenario_key(std::string_view path);

/// True when other keys lie below: the value is a map or a list of maps.
bool has_keys_below(std::string_view path);

/// What may be written for `key`, for messages and for the documentation: "a number in (0, 1]".
std::string allowed_text(const Key& key);

/// The declared key, or map on the way to one, that is nearest to a misspelt `path`.
std::string nearest_scenario_key(std::string_view path);

/// The table of docs/scenario.md, in Markdown.
std::string scenario_key_table();

}  // namespace tachless::experiment
