#pragma once

#include <cstddef>
#include <string>

namespace tachless::report {

/// Returns the number of occurrences of `what` in `text`.
inline std::size_t count(const std::string& text, const std::string& what) {
  std::size_t found = 0;
  for (std::size_t at = 0; (at = text.find(what, at)) != std::string::npos; ++at) ++found;
  return found;
}

}  // namespace tachless::report
