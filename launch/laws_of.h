#pragma once

#include <string>
#include <vector>

#include "experiment/scenario.h"

namespace tachless::launch {

/// The laws named by --laws, or with "all" every law made for the scenario's joints and reference.
/// @throw diagnostics::Failure(bad_usage) for a name that is no law
std::vector<std::string> laws_of(const experiment::Scenario& scenario,
                                 const std::vector<std::string>& names);

}  // namespace tachless::launch
