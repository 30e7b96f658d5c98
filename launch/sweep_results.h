#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "study/sweep.h"

/// What a finished sweep leaves in its directory, and says of itself. Runs nothing.
namespace tachless::launch {

struct SweepResults {
  std::filesystem::path directory;
  std::size_t runs = 0;
  std::map<std::string, std::int64_t> outcomes;  ///< how many runs ended how, over all laws
};

/// Writes results.csv, results.h5, map.svg and index.html. @param colour as for
/// `report::write_sweep_page`
/// @throw diagnostics::Failure as `study::Sweep::rows` and `report::write_sweep_page`
SweepResults write_sweep_results(const study::Sweep& sweep, const std::string& colour);

/// For people.
std::string to_text(const SweepResults& results);

nlohmann::ordered_json to_json(const SweepResults& results);

}  // namespace tachless::launch
