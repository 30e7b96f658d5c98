#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

/// A table of numbers as an HDF5 file. Knows nothing of runs (hdf5_file.h does).
namespace tachless::logger {

/// A dataset. Of a column of choices the values are indices into `choices`, which the attribute of
/// that name lists, with commas between.
struct NumberColumn {
  std::string name, unit;
  std::vector<double> values;
  std::vector<std::string> choices;
};

/// Overwrites `path`. @param texts datasets of one text each, by name
/// @throw diagnostics::Failure(bad_usage) when it cannot be written
void write_hdf5_columns(const std::filesystem::path& path, const std::vector<NumberColumn>& columns,
                        const std::map<std::string, std::string>& texts);

}  // namespace tachless::logger
