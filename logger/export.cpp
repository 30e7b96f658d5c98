#include "logger/export.h"

#include <system_error>
#include <utility>

#include "diagnostics/failure.h"
#include "logger/csv_file.h"
#include "logger/hdf5_file.h"
#include "logger/table.h"

namespace tachless::logger {
namespace {

/// The name under which a file is written until it is whole.
class Unfinished {
 public:
  Unfinished(std::filesystem::path path, bool force) : path_(std::move(path)) {
    std::error_code error;
    const auto status = std::filesystem::status(path_, error);
    if (std::filesystem::is_directory(status)) {
      refuse("is a directory; name a file");
    }
    // A pipe or a terminal is written to as it is.
    direct_ = std::filesystem::exists(status) && !std::filesystem::is_regular_file(status);
    if (std::filesystem::exists(status) && !direct_ && !force) {
      refuse("exists already; name another file, or overwrite it with --force");
    }
    if (!direct_) partial_ = path_.string() + ".partial";
  }
  Unfinished(const Unfinished&) = delete;
  Unfinished& operator=(const Unfinished&) = delete;
  ~Unfinished() {
    std::error_code ignored;
    if (!direct_) std::filesystem::remove(partial_, ignored);
  }

  [[nodiscard]] const std::filesystem::path& name() const { return direct_ ? path_ : partial_; }
  [[nodiscard]] bool direct() const { return direct_; }

  void finish() {
    if (direct_) return;
    std::error_code error;
    std::filesystem::rename(partial_, path_, error);
    if (error) refuse("cannot be written: " + error.message());
  }

 private:
  [[noreturn]] void refuse(const std::string& problem) const {
    throw diagnostics::Failure(diagnostics::ExitCode::bad_usage, path_.string() + ": " + problem);
  }

  std::filesystem::path path_;
  std::filesystem::path partial_;
  bool direct_ = false;
};

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
  if (ending == ".csv") return ExportFormat::csv;
  if (ending == ".h5" || ending == ".hdf5") return ExportFormat::hdf5;
  throw diagnostics::Failure(
      diagnostics::ExitCode::bad_usage,
      path.string() + ": unknown kind of file; end its name in .csv, .h5 or .hdf5");
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
  Unfinished unfinished(path, force);
  const auto quantities = quantities_of(log);
  ExportResult result;
  log.rewind();
  if (format == ExportFormat::csv) {
    CsvFile file(unfinished.name(), quantities, log.info().period_s);
    write_rows(log, quantities, file, result);
  } else {
    if (unfinished.direct()) {
      throw diagnostics::Failure(diagnostics::ExitCode::bad_usage,
                                 path.string() + ": HDF5 needs a regular file; name one");
    }
    Hdf5File file(unfinished.name(), quantities, log);
    write_rows(log, quantities, file, result);
  }
  unfinished.finish();
  result.summary = log.summary();
  result.damage = log.damage();
  return result;
}

}  // namespace tachless::logger
