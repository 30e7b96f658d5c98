#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "logger/run_log.h"

/// A run as a table in a file, one row per tick; docs/log.md lists the columns.
namespace tachless::logger {

struct ExportResult {
  RunSummary summary;  ///< summary of the run; the table has a row for each tick that has a message
  Damage damage;
  std::uint64_t missing_values = 0;  ///< missing values of the quantities in the rows written

  /// Returns one line for people: rows and missing values.
  [[nodiscard]] std::string text() const;
};

/// Writes the run in `log` from its start to `path`, front to back in bounded memory. Numbers read
/// back the same (%.17g). CSV (`-`: to standard output) has a header line, then a line per tick; a
/// value that the log lacks is an empty cell. The class McapTable in export.cpp describes the
/// messages of an MCAP file. The file appears under its name only when it is complete; an earlier
/// one stays in place until then.
/// @throw base::Failure(bad_usage) when the name ends in neither .csv nor .mcap, when `path`
/// exists (without `force`) or cannot be written, or the disk is full.
ExportResult export_run(RunLog& log, const std::filesystem::path& path, bool force = false);

}  // namespace tachless::logger
