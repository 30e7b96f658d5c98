#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "logger/run_log.h"

/// Tables as files: a run, one row per tick (docs/log.md lists the columns), or columns of numbers.
namespace tachless::logger {

enum class ExportFormat { csv, hdf5 };

/// By the ending: .csv, and `-`, standard output; .h5, .hdf5.
/// @throw diagnostics::Failure(bad_usage) for any other.
ExportFormat export_format_of(const std::filesystem::path& path);

struct ExportResult {
  RunSummary summary;  ///< a row for each of its ticks
  Damage damage;
  std::uint64_t missing_values = 0;  ///< of the quantities in rows written

  /// One line for people: rows, what is missing.
  [[nodiscard]] std::string text() const;
};

/// Writes the run in `log` from its start to `path`, front to back in bounded memory. CSV has a
/// header line, then a line per tick, with numbers that read back the same (%.17g). A value that
/// the log lacks is an empty cell in CSV, and masked out in HDF5. The file appears under its name
/// only when it is whole; what is in its place stays there until then.
/// @throw diagnostics::Failure(bad_usage) when `path` exists (without `force`), cannot be written,
/// or the disk is full.
ExportResult export_run(RunLog& log, const std::filesystem::path& path, ExportFormat format,
                        bool force = false);

/// A dataset. Of a column of choices the values are indices into `choices`, which the attribute of
/// that name lists, with commas between.
struct NumberColumn {
  std::string name, unit;
  std::vector<double> values;
  std::vector<std::string> choices;
};

/// Overwrites the HDF5 file `path`. @param texts datasets of one text each, by name
/// @throw diagnostics::Failure(bad_usage) when it cannot be written
void write_hdf5_columns(const std::filesystem::path& path, const std::vector<NumberColumn>& columns,
                        const std::map<std::string, std::string>& texts);

}  // namespace tachless::logger
