#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace tachless::diagnostics {

/// Rows of cells as lines: two spaces before each cell, columns as wide as their widest cell.
/// @param alignment a letter for each column, l to the left or r to the right; the last one is for
/// all that follow. Not empty.
std::string table(const std::vector<std::vector<std::string>>& rows, std::string_view alignment);

}  // namespace tachless::diagnostics
