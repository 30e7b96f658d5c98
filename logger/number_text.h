#pragma once

#include <cstddef>

namespace tachless::logger {

inline constexpr std::size_t longest_number = 32;

/// Writes `value` with 17 significant digits, byte for byte as printf's "%.17g", several times as
/// fast. @return the end of what was written, at most `longest_number` behind `to`.
char* write_number(char* to, double value);

}  // namespace tachless::logger
