#include "logger/export.h"

#include <fcntl.h>
#include <fmt/core.h>
#include <hdf5.h>
#include <hdf5_hl.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdio>
#include <functional>
#include <string_view>
#include <system_error>
#include <utility>

#include "diagnostics/failure.h"
#include "diagnostics/file_text.h"
#include "diagnostics/text.h"
#include "logger/number_text.h"
#include "logger/table.h"

namespace tachless::logger {
namespace {

constexpr std::size_t block_bytes = 1 << 18;

/// Comma-separated values; to `-`, standard output, is added, anything else overwritten.
class CsvTable {
 public:
  CsvTable(const std::filesystem::path& path, const std::vector<Quantity>& quantities,
           double period_s)
      : path_(path), quantities_(quantities), period_s_(period_s) {
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
  void add(double value) {
    std::array<char, 1 + longest_number> text = {','};
    block_.append(text.data(), write_number(&text[1], value));
  }

  void write() {
    if (std::fwrite(block_.data(), 1, block_.size(), file_) != block_.size()) fail(errno);
    block_.clear();
  }

  [[noreturn]] void fail(int error) const {
    throw diagnostics::bad_usage(
        "{}: cannot write: {}; {}", path_.string(), std::generic_category().message(error),
        error == ENOSPC ? "free some space, or name a file on another disk" : "name another file");
  }

  std::filesystem::path path_;
  const std::vector<Quantity>& quantities_;
  double period_s_;
  std::FILE* file_ = nullptr;
  std::string block_;  ///< rows that are written at once
};

constexpr hsize_t chunk_rows = 4096;

std::string mask_name(Slot slot) { return fmt::format("present/{}", name(slot)); }

/// One dataset per quantity, ticks x joints, with attributes `unit`, `description` and
/// `present`: the path of the mask (ticks, 0 or 1) that tells in which rows it has values. Rows
/// without are zero. The file's attributes are the run's id and what else RUN_INFO says.
class Hdf5Table {
 public:
  Hdf5Table(const std::filesystem::path& path, const std::vector<Quantity>& quantities,
            const RunLog& log)
      : path_(path) {
    // After a failed write the library's own clean-up at exit would try, and complain, for ever.
    H5dont_atexit();
    H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
    file_ = check(H5Fcreate(path.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT));
    attribute(file_, "run_id", log.run());
    loop::for_each_field<loop::RunInfo>(
        [&](const auto& field) { attribute(file_, field.name, log.info().*field.member); });
    add("tick", H5T_STD_I64LE, 0, "1", "number of the tick, counted from 0",
        [](const TickRecord& record, double* to) { *to = static_cast<double>(record.tick); });
    add("t_s", H5T_IEEE_F64LE, 0, "s", "time of the tick, tick times period",
        [period_s = log.info().period_s](const TickRecord& record, double* to) {
          *to = static_cast<double>(record.tick) * period_s;
        });
    H5Gclose(check(H5Gcreate2(file_, "present", H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT)));
    for (const Slot slot : loop::all_slots) {
      add(mask_name(slot), H5T_STD_U8LE, 0, "1",
          "1 where the log has the message " + log.summary().of(slot).channel,
          [slot](const TickRecord& record, double* to) { *to = has(record, slot) ? 1 : 0; });
    }
    for (const Quantity& quantity : quantities) {
      const auto& units = quantity.units;
      const bool one = std::ranges::count(units, units.front()) == std::ssize(units);
      const hid_t id =
          add(quantity.name, quantity.whole ? H5T_STD_I8LE : H5T_IEEE_F64LE, quantity.joints.size(),
              one ? units.front() : diagnostics::joined(units, ","), quantity.description,
              [&quantity](const TickRecord& record, double* to) {
                if (has(record, quantity.slot)) quantity.read(record, to);
              });
      attribute(id, "present", "/" + mask_name(quantity.slot));
      if (!quantity.joints.empty()) {
        attribute(id, "joints", diagnostics::joined(quantity.joints, ","));
      }
    }
  }

  void append(const TickRecord& record) {
    for (Dataset& each : datasets_) {
      const std::size_t width = std::max<hsize_t>(each.columns, 1);
      each.values.resize(each.values.size() + width, 0.0);
      each.read(record, &each.values[each.values.size() - width]);
    }
    if (++buffered_ == chunk_rows) flush();
  }

  void close() {
    flush();
    for (const Dataset& each : datasets_) check(H5Dclose(each.id));
    check(H5Fflush(file_, H5F_SCOPE_GLOBAL));
    check(H5Fclose(std::exchange(file_, H5I_INVALID_HID)));
  }

 private:
  /// The values of a record, zeros before.
  using Read = std::function<void(const TickRecord&, double* to)>;
  struct Dataset {
    hid_t id = H5I_INVALID_HID;
    hsize_t columns = 0;  ///< 0: one-dimensional
    Read read;
    std::vector<double> values;  ///< of the rows not yet written
  };

  /// HDF5's identifiers and results are negative when a call has failed.
  template <class Result>
  Result check(Result result) const {
    if (result >= 0) return result;
    struct statvfs disk {};
    const auto directory = path_.has_parent_path() ? path_.parent_path() : ".";
    const bool full = statvfs(directory.c_str(), &disk) == 0 && disk.f_bavail == 0;
    throw diagnostics::bad_usage(
        path_.string() + ": cannot write: " +
        (full ? "No space left on device; free some space, or name a file on another disk"
              : "the file system refused; check directory, rights and limits, or name another "
                "file"));
  }

  void attribute(hid_t object, std::string_view name, const std::string& text) const {
    const hid_t type = check(H5Tcopy(H5T_C_S1));
    check(H5Tset_size(type, text.size() + 1));
    check(H5Tset_cset(type, H5T_CSET_UTF8));
    attribute(object, name, type, text.c_str());
    check(H5Tclose(type));
  }
  void attribute(hid_t object, std::string_view name, std::int64_t number) const {
    attribute(object, name, H5T_NATIVE_INT64, &number);
  }
  void attribute(hid_t object, std::string_view name, double number) const {
    attribute(object, name, H5T_NATIVE_DOUBLE, &number);
  }
  void attribute(hid_t object, std::string_view name, hid_t type, const void* value) const {
    const hid_t space = check(H5Screate(H5S_SCALAR));
    const hid_t id =
        check(H5Acreate2(object, std::string(name).c_str(), type, space, H5P_DEFAULT, H5P_DEFAULT));
    check(H5Awrite(id, type, value));
    check(H5Aclose(id));
    check(H5Sclose(space));
  }

  hid_t add(const std::string& name, hid_t type, hsize_t columns, const std::string& unit,
            const std::string& description, Read read) {
    const int rank = columns == 0 ? 1 : 2;
    const std::array<hsize_t, 2> size = {0, columns};
    const std::array<hsize_t, 2> most = {H5S_UNLIMITED, columns};
    const std::array<hsize_t, 2> chunk = {chunk_rows, columns};
    const hid_t space = check(H5Screate_simple(rank, size.data(), most.data()));
    const hid_t properties = check(H5Pcreate(H5P_DATASET_CREATE));
    check(H5Pset_chunk(properties, rank, chunk.data()));
    Dataset& dataset = datasets_.emplace_back();
    dataset.columns = columns;
    dataset.read = std::move(read);
    dataset.values.reserve(chunk_rows * std::max<hsize_t>(columns, 1));
    dataset.id =
        check(H5Dcreate2(file_, name.c_str(), type, space, H5P_DEFAULT, properties, H5P_DEFAULT));
    check(H5Pclose(properties));
    check(H5Sclose(space));
    attribute(dataset.id, "unit", unit);
    attribute(dataset.id, "description", description);
    return dataset.id;
  }

  void write(Dataset& dataset) const {
    const int rank = dataset.columns == 0 ? 1 : 2;
    const std::array<hsize_t, 2> size = {written_ + buffered_, dataset.columns};
    const std::array<hsize_t, 2> start = {written_, 0};
    const std::array<hsize_t, 2> count = {buffered_, dataset.columns};
    check(H5Dset_extent(dataset.id, size.data()));
    const hid_t space = check(H5Dget_space(dataset.id));
    check(H5Sselect_hyperslab(space, H5S_SELECT_SET, start.data(), nullptr, count.data(), nullptr));
    // Of the same shape: H5DOappend takes several times as long.
    const hid_t memory = check(H5Screate_simple(rank, count.data(), nullptr));
    check(
        H5Dwrite(dataset.id, H5T_NATIVE_DOUBLE, memory, space, H5P_DEFAULT, dataset.values.data()));
    check(H5Sclose(memory));
    check(H5Sclose(space));
    dataset.values.clear();
  }

  void flush() {
    if (buffered_ == 0) return;
    for (Dataset& each : datasets_) write(each);
    written_ += std::exchange(buffered_, 0);
  }

  std::filesystem::path path_;
  hid_t file_ = H5I_INVALID_HID;
  std::vector<Dataset> datasets_;
  hsize_t written_ = 0, buffered_ = 0;  ///< rows
};

/// A row for each tick.
template <class Table>
void fill(Table&& table, RunLog& log) {
  for (TickRecord record; log.next(record);) table.append(record);
  table.close();
}

}  // namespace

ExportFormat export_format_of(const std::filesystem::path& path) {
  const auto ending = path.extension();
  if (ending == ".csv" || path == "-") return ExportFormat::csv;
  if (ending == ".h5" || ending == ".hdf5") return ExportFormat::hdf5;
  throw diagnostics::bad_usage(
      "{}: unknown kind of file; end its name in .csv, .h5 or .hdf5, or write CSV to standard "
      "output by -",
      path.string());
}

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

ExportResult export_run(RunLog& log, const std::filesystem::path& path, ExportFormat format,
                        bool force) {
  const auto quantities = quantities_of(log);
  const auto write = [&](const std::filesystem::path& to) {
    if (format == ExportFormat::csv)
      return fill(CsvTable(to, quantities, log.info().period_s), log);
    fill(Hdf5Table(to, quantities, log), log);
  };
  log.rewind();
  if (path == "-") {
    write(path);
  } else {
    std::error_code error;
    if (!force && std::filesystem::is_regular_file(path, error)) {
      throw diagnostics::bad_usage(
          "{}: exists already; name another file, or overwrite it with --force", path.string());
    }
    diagnostics::UnfinishedFile unfinished(path, "name another file with -o");
    if (format == ExportFormat::hdf5 && unfinished.direct()) {
      throw diagnostics::bad_usage("{}: HDF5 needs a regular file; name one", path.string());
    }
    write(unfinished.name());
    unfinished.finish();
  }
  ExportResult result{log.summary(), log.damage()};
  for (const Quantity& quantity : quantities) {
    const std::uint64_t missing = result.summary.ticks - result.summary.of(quantity.slot).count;
    result.missing_values += missing * quantity.units.size();
  }
  return result;
}

void write_hdf5_columns(const std::filesystem::path& path, const std::vector<NumberColumn>& columns,
                        const std::map<std::string, std::string>& texts) {
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
  const auto check = [&](auto result) {
    if (result >= 0) return result;
    throw diagnostics::bad_usage(
        "{}: cannot write: the file system refused; check directory, rights, limits and room",
        path.string());
  };
  const hid_t file = check(H5Fcreate(path.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT));
  for (const auto& [name, text] : texts) {
    check(H5LTmake_dataset_string(file, name.c_str(), text.c_str()));
  }
  for (const NumberColumn& column : columns) {
    const hsize_t size = column.values.size();
    const char* name = column.name.c_str();
    check(H5LTmake_dataset_double(file, name, 1, &size, column.values.data()));
    check(H5LTset_attribute_string(file, name, "unit", column.unit.c_str()));
    if (column.choices.empty()) continue;
    check(H5LTset_attribute_string(file, name, "choices",
                                   diagnostics::joined(column.choices, ",").c_str()));
  }
  check(H5Fclose(file));
}

}  // namespace tachless::logger
