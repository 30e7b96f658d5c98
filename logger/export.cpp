#include "logger/export.h"

#include <fcntl.h>
#include <fmt/core.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdio>
#include <string_view>
#include <system_error>
#include <utility>

#include "diagnostics/failure.h"
#include "diagnostics/file_text.h"
#include "diagnostics/text.h"
#include "logger/mcap_table.h"
#include "logger/table.h"

namespace tachless::logger {
namespace {

constexpr std::size_t block_bytes = 1 << 18;

/// Comma-separated values; to `-`, standard output, is added, anything else overwritten.
class CsvTable {
 public:
  CsvTable(const std::filesystem::path& path, const std::vector<Quantity>& quantities,
           double period_s)
      : quantities_(quantities), period_s_(period_s) {
    file_ = path == "-" ? ::fdopen(::fcntl(STDOUT_FILENO, F_DUPFD_CLOEXEC, 0), "w")
                        : std::fopen(path.c_str(), "we");
    if (file_ == nullptr) fail(errno);
    block_ = "tick,t_s";
    for (const auto& quantity : quantities_) {
      for (std::size_t i = 0; i < quantity.units.size(); ++i) {
        block_.append(1, ',').append(diagnostics::csv_field(quantity.column(i)));
      }
    }
    block_ += '\n';
  }
  CsvTable(const CsvTable&) = delete;
  CsvTable& operator=(const CsvTable&) = delete;
  ~CsvTable() {
    if (file_ != nullptr) std::fclose(file_);
  }

  void append(const TickRecord& record) {
    if (block_.size() >= block_bytes) write();
    block_ += std::to_string(record.tick);
    add(static_cast<double>(record.tick) * period_s_);
    std::array<double, robot::max_joints> values;
    for (const auto& quantity : quantities_) {
      const bool present = has(record, quantity.slot);
      if (present) quantity.read(record, values.data());
      for (std::size_t i = 0; i < quantity.units.size(); ++i) {
        present ? add(values[i]) : block_.push_back(',');
      }
    }
    block_ += '\n';
  }

  void close() {
    write();
    if (std::fclose(std::exchange(file_, nullptr)) != 0) fail(errno);
  }

 private:
  void add(double value) { add_number(block_ += ',', value); }

  void write() {
    if (std::fwrite(block_.data(), 1, block_.size(), file_) != block_.size()) fail(errno);
    block_.clear();
  }

  [[noreturn]] static void fail(int error) {
    throw std::system_error(error, std::generic_category());
  }

  const std::vector<Quantity>& quantities_;
  double period_s_;
  std::FILE* file_ = nullptr;
  std::string block_;  ///< rows that are written at once
};

/// A row for each tick, in a file of that name.
void write_rows(const std::filesystem::path& to, bool mcap, const std::vector<Quantity>& quantities,
                RunLog& log) {
  const auto write = [&](auto&& table) {
    for (TickRecord record; log.next(record);) table.append(record);
    table.close();
  };
  mcap ? write(McapTable(to, quantities, log))
       : write(CsvTable(to, quantities, log.info().period_s));
}

}  // namespace

std::string ExportResult::text() const {
  std::string text = fmt::format("{} ticks", summary.ticks);
  if (missing_values != 0) text += fmt::format(", {} values missing", missing_values);
  for (const auto& piece : summary.pieces) {
    if (piece.absent()) {
      if (summary.ticks != 0) text += "; no " + piece.channel;
    } else if (piece.missing.count != 0) {
      text += fmt::format("; {} missing in {} ticks", piece.channel, piece.missing.count);
    }
  }
  if (damage.any()) {
    text += fmt::format("; the log is damaged ({} bytes lost)", damage.bytes_skipped);
  }
  return text;
}

ExportResult export_run(RunLog& log, const std::filesystem::path& path, bool force) {
  const bool mcap = path.extension() == ".mcap";
  if (path != "-" && !mcap && path.extension() != ".csv") {
    throw diagnostics::bad_usage(
        "{}: unknown kind of file; end its name in .csv or .mcap, or write the table to standard "
        "output by -",
        path.string());
  }
  const auto quantities = quantities_of(log);
  log.rewind();
  std::error_code error;
  if (path != "-" && !force && std::filesystem::is_regular_file(path, error)) {
    throw diagnostics::bad_usage(
        "{}: exists already; name another file, or overwrite it with --force", path.string());
  }
  try {
    if (path == "-") {
      write_rows(path, mcap, quantities, log);
    } else {
      diagnostics::UnfinishedFile unfinished(path, "name another file with -o");
      write_rows(unfinished.name(), mcap, quantities, log);
      unfinished.finish();
    }
  } catch (const std::system_error& problem) {
    throw diagnostics::bad_usage("{}: cannot write: {}; {}", path.string(),
                                 problem.code().message(),
                                 problem.code() == std::errc::no_space_on_device
                                     ? "free some space, or name a file on another disk"
                                     : "name another file");
  }
  ExportResult result{log.summary(), log.damage()};
  for (const Quantity& quantity : quantities) {
    const std::uint64_t missing = result.summary.ticks - result.summary.of(quantity.slot).count;
    result.missing_values += missing * quantity.units.size();
  }
  return result;
}

}  // namespace tachless::logger
