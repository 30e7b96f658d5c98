#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "logger/run_log.h"

/// A run as a table in a file, one row per tick; docs/log.md lists the columns.
namespace tachless::logger {

struct ExportResult {
  RunSummary summary;  ///< a row for each of its ticks
  Damage damage;
  std::uint64_t missing_values = 0;  ///< of the quantities in rows written

  /// One line for people: rows, what is missing.
  [[nodiscard]] std::string text() const;
};

/// Writes the run in `log` from its start to `path`, front to back in bounded memory, with numbers
/// that read back the same (%.17g): as CSV (`-`: to standard output) a header line, then a line per
/// tick, where a value that the log lacks is an empty cell; as MCAP see McapTable in export.cpp.
/// The file appears under its name only when it is whole; an earlier one stays in place until then.
/// @throw base::Failure(bad_usage) when the name ends in neither .csv nor .mcap, when `path`
/// exists (without `force`) or cannot be written, or the disk is full.
ExportResult export_run(RunLog& log, const std::filesystem::path& path, bool force = false);

}  // namespace tachless::logger
