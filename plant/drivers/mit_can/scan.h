#pragma once

#include <chrono>
#include <iosfwd>
#include <string>

namespace tachless::mit_can {

struct ScanRange {
  int last_damiao = 63, last_robstride = 127;  ///< identifiers, from 1
  std::chrono::milliseconds answer_time{3};    ///< longest time for each answer
};

/// Prints a line for each drive that answers on the bus: family, identifiers, state, and a Damiao's
/// ranges. It enables nothing.
/// @return the number of drives
/// @throw base::Failure(bad_usage) when the bus cannot be opened
int scan(const std::string& bus, bool fd, std::ostream& to, const ScanRange& range = {});

}  // namespace tachless::mit_can
