#include "logger/export.h"

#include <system_error>

#include "diagnostics/failure.h"
#include "diagnostics/unfinished_file.h"
#include "logger/csv_file.h"
#include "logger/hdf5_file.h"
#include "logger/table.h"

namespace tachless::logger {
namespace {

/// @throw Failure(bad_usage) when there is a file already that is not to be replaced
void require_free(const std::filesystem::path& path) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error)) return;
  throw diagnostics::bad_usage(path.string() +
                               ": exists already; name another file, or overwrite it with --force");
}

template <class File>
void write_rows(RunLog& log, const std::vector<Quantity>& quantities, File& file,
                ExportResult& result) {
  TickRecord record;
  while (log.next(record)) {
    file.append(record);
    ++result.rows;
    for (const auto& quantity : quantities) {
      if (!has(record, quantity.slot)) result.missing_values += quantity.units.size();
    }
  }
  file.close();
}

}  // namespace

ExportFormat export_format_of(const std::filesystem::path& path) {
  const auto ending = path.extension();
  if (ending == ".csv" || path == "-") return ExportFormat::csv;
  if (ending == ".h5" || ending == ".hdf5") return ExportFormat::hdf5;
  throw diagnostics::bad_usage(path.string() +
                               ": unknown kind of file; end its name in .csv, .h5 or .hdf5, or "
                               "write CSV to standard output by -");
}

std::string ExportResult::text() const {
  std::string text = std::to_string(rows) + " ticks";
  if (missing_values != 0) text += ", " + std::to_string(missing_values) + " values missing";
  for (const auto& piece : summary.pieces) {
    if (piece.absent()) {
      if (rows != 0) text += "; no " + piece.channel;
    } else if (piece.missing != 0) {
      text += "; " + piece.channel + " missing in " + std::to_string(piece.missing) + " ticks";
    }
  }
  if (damage.any()) {
    text += "; the log is damaged (" + std::to_string(damage.bytes_skipped) + " bytes lost)";
  }
  return text;
}

ExportResult export_run(RunLog& log, const std::filesystem::path& path, ExportFormat format,
                        bool force) {
  const auto quantities = quantities_of(log);
  ExportResult result;
  const auto write_csv = [&](const std::filesystem::path& to) {
    CsvFile file(to, quantities, log.info().period_s);
    write_rows(log, quantities, file, result);
  };
  log.rewind();
  if (path == "-") {
    write_csv(path);
  } else {
    if (!force) require_free(path);
    diagnostics::UnfinishedFile unfinished(path, "name another file with -o");
    if (format == ExportFormat::csv) {
      write_csv(unfinished.name());
    } else {
      if (unfinished.direct()) {
        throw diagnostics::bad_usage(path.string() + ": HDF5 needs a regular file; name one");
      }
      Hdf5File file(unfinished.name(), quantities, log);
      write_rows(log, quantities, file, result);
    }
    unfinished.finish();
  }
  result.summary = log.summary();
  result.damage = log.damage();
  return result;
}

}  // namespace tachless::logger
