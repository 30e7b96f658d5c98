#include "experiment/scenario_keys.h"

#include <fmt/format.h>

#include <algorithm>

#include "diagnostics/text.h"
#include "experiment/scenario.h"

namespace tachless::experiment {
namespace {

const std::vector<std::string>& paths() {
  static const std::vector<std::string> all = [] {
    std::vector<std::string> made;
    for_each_path<Scenario>(
        "", [&](const std::string& path, const auto&... /*key*/) { made.push_back(path); });
    return made;
  }();
  return all;
}

std::string without_indices(std::string_view path) {
  std::string plain;
  bool inside = false;
  for (const char c : path) {
    if (c == '[') inside = true;
    if (!inside) plain += c;
    if (c == ']') inside = false;
  }
  return plain;
}

std::string_view parent(std::string_view path) {
  const std::size_t dot = path.rfind('.');
  return dot == std::string_view::npos ? std::string_view{} : path.substr(0, dot);
}

std::string_view last_name(std::string_view path) { return path.substr(path.rfind('.') + 1); }

}  // namespace

bool is_scenario_key(std::string_view path) {
  const std::string plain = without_indices(path), chosen = fmt::format("{}.<name>", parent(plain));
  return std::ranges::any_of(paths(),
                             [&](const std::string& key) { return key == plain || key == chosen; });
}

bool has_keys_below(std::string_view path) {
  const std::string plain = without_indices(path);
  return std::ranges::any_of(paths(), [&](const std::string& key) { return parent(key) == plain; });
}

std::string known_keys_hint(std::string_view path, const std::vector<std::string>& gains) {
  const std::string plain = without_indices(path);
  // A misspelt name in its right map is likelier than a right name in a wrong map.
  std::vector<std::string_view> siblings;
  std::vector<std::string> elsewhere;
  for (const std::string& key : paths()) {
    if (last_name(key) == "<name>") continue;
    if (parent(key) == parent(plain)) siblings.push_back(last_name(key));
    if (!plain.starts_with(key + ".")) elsewhere.push_back(key);
  }
  for (const std::string& gain : gains) elsewhere.push_back("controller.gains." + gain);
  const std::string prefix = parent(plain).empty() ? "" : fmt::format("{}.", parent(plain));
  if (const auto near = diagnostics::nearest(last_name(plain), siblings)) {
    return fmt::format("nearest known key is {}{}", prefix, *near);
  }
  if (const auto near = diagnostics::nearest(last_name(plain), elsewhere)) {
    return "nearest known key is " + *near;
  }
  return fmt::format("known keys {}: {}",
                     prefix.empty() ? "of a scenario" : fmt::format("of {}", parent(plain)),
                     diagnostics::joined(siblings));
}

}  // namespace tachless::experiment
