#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "tests/soak/driver.h"
#include "tests/soak/spec.h"

namespace tachless::soak {

struct Verdict {
  std::vector<std::string> problems;  ///< what was promised and did not hold; empty: all did
  nlohmann::json summary;             ///< summary.json, null when there was none
};

/// Compares what was seen of a run, what it left on the disk and which processes it left behind
/// (they are this process's children, and are killed) with what docs/operations.md promises.
/// @param clean the log that a lock-step run has to equal, or begin with; none: this is the first
Verdict judge(const Spec& spec, const Observation& seen,
              const std::optional<std::filesystem::path>& clean);

}  // namespace tachless::soak
