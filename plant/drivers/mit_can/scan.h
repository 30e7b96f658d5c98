#pragma once

#include <iosfwd>
#include <string>

namespace tachless::mit_can {

/// Prints a line for each drive that answers on the bus: family, identifiers, state, and a Damiao's
/// ranges. It enables nothing.
/// @return the number of drives
/// @throw base::Failure(bad_usage) when the bus cannot be opened
int scan(const std::string& bus, bool fd, std::ostream& to);

}  // namespace tachless::mit_can
