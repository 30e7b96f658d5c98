#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "logger/run_log.h"

/// A run as a table: one row per tick. docs/log.md lists the columns.
namespace tachless::logger {

enum class ExportFormat { csv, hdf5 };

/// By the ending: .csv, and `-`, standard output; .h5, .hdf5.
/// @throw diagnostics::Failure(bad_usage) for any other.
ExportFormat export_format_of(const std::filesystem::path& path);

struct ExportResult {
  std::uint64_t rows = 0;
  std::uint64_t missing_values = 0;  ///< of the quantities in rows written
  RunSummary summary;
  Damage damage;

  /// One line for people: rows, what is missing.
  [[nodiscard]] std::string text() const;
};

/// Writes the run in `log` from its start to `path`, front to back in bounded memory. A value that
/// the log lacks is an empty cell in CSV, and masked out in HDF5. The file appears under its name
/// only when it is whole; what is in its place stays there until then.
/// @throw diagnostics::Failure(bad_usage) when `path` exists (without `force`), cannot be written,
/// or the disk is full.
ExportResult export_run(RunLog& log, const std::filesystem::path& path, ExportFormat format,
                        bool force = false);

}  // namespace tachless::logger
