#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "experiment/scenario.h"
#include "study/compare.h"

namespace tachless::report {

/// A law of a comparison, and what was set for it in the scenario.
struct ComparedLaw {
  study::Compared result;
  std::vector<std::string> overrides;
};

/// The table for people.
std::string comparison_table(const std::vector<ComparedLaw>& laws);

/// The same numbers, keys as in compare.json of docs/studies.md.
nlohmann::ordered_json to_json(const std::vector<ComparedLaw>& laws);

/// Writes compare.svg, compare.json and index.html into `directory`.
/// @throw diagnostics::Failure(bad_usage) when they cannot be written
void write_comparison(const experiment::Scenario& scenario, const std::string& rule,
                      const std::vector<ComparedLaw>& laws, const std::filesystem::path& directory);

}  // namespace tachless::report
