#pragma once

#include <string>
#include <string_view>
#include <vector>

/// All keys of a scenario, as a list made of the declarations beside the specs: to tell unknown
/// keys from known ones, and for the table of docs/scenario.md. Does not read values (reader.h).
namespace tachless::experiment {

struct ScenarioKey {
  /// "loop.period_s"; entries of a list go without index, "<name>" stands for the user's choice.
  std::string path;
  std::string_view unit;
  std::string fallback;  ///< as in the documentation's table
  std::string allowed;
  std::string_view meaning;  ///< empty for a map, which is not in the table
};

const std::vector<ScenarioKey>& scenario_keys();

/// True for a declared key. `path` may have indices: "reference.multi_sine.terms[2].phase_rad".
bool is_scenario_key(std::string_view path);

/// True when other keys lie below: the value is a map or a list of maps.
bool has_keys_below(std::string_view path);

/// "nearest known key is loop.period_s" for the unknown `path`, or else the keys of its map.
/// `gains` are names in controller.gains, which the table does not know.
std::string known_keys_hint(std::string_view path, const std::vector<std::string>& gains = {});

/// The table of docs/scenario.md, in Markdown.
std::string scenario_key_table();

}  // namespace tachless::experiment
