#pragma once

#include <optional>
#include <string>

namespace tachless::process {

/// Why no window can be opened from here, in one line with a remedy; nothing when there is an X
/// display that answers. Looks at $DISPLAY and at the server behind it, and opens nothing.
std::optional<std::string> display_problem();

}  // namespace tachless::process
