#include "logger/hdf5_file.h"

#include <fmt/core.h>
#include <hdf5.h>
#include <sys/statvfs.h>

#include <algorithm>
#include <string>
#include <utility>

#include "diagnostics/failure.h"
#include "diagnostics/text.h"

namespace tachless::logger {
namespace {

constexpr hsize_t chunk_rows = 4096;

std::string mask_name(Slot slot) { return fmt::format("present/{}", name(slot)); }

}  // namespace

class Hdf5File::Impl {
 public:
  Impl(const std::filesystem::path& path, const std::vector<Quantity>& quantities,
       const RunLog& log)
      : path_(path), quantities_(quantities), period_s_(log.info().period_s) {
    // After a failed write the library's own clean-up at exit would try, and complain, for ever.
    H5dont_atexit();
    H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
    file_ = check(H5Fcreate(path.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT));
    describe(log);
    tick_ = create("tick", H5T_STD_I64LE, 0, "1", "number of the tick, counted from 0");
    t_ = create("t_s", H5T_IEEE_F64LE, 0, "s", "time of the tick, tick times period");
    H5Gclose(check(H5Gcreate2(file_, "present", H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT)));
    for (std::size_t i = 0; i < masks_.size(); ++i) {
      masks_[i] = create(mask_name(loop::all_slots[i]), H5T_STD_U8LE, 0, "1",
                         "1 where the log has the message " + log.summary().pieces[i].channel);
    }
    for (const auto& quantity : quantities_) {
      const auto& units = quantity.units;
      const bool one = std::ranges::count(units, units.front()) == std::ssize(units);
      const hsize_t columns = quantity.joints.size();
      auto column =
          create(quantity.name, quantity.whole ? H5T_STD_I8LE : H5T_IEEE_F64LE, columns,
                 one ? units.front() : diagnostics::joined(units, ","), quantity.description);
      attribute(column.id, "present", "/" + mask_name(quantity.slot));
      if (columns > 0) attribute(column.id, "joints", diagnostics::joined(quantity.joints, ","));
      columns_.push_back(std::move(column));
    }
  }

  void append(const TickRecord& record) {
    tick_.values.push_back(static_cast<double>(record.tick));
    t_.values.push_back(static_cast<double>(record.tick) * period_s_);
    for (std::size_t i = 0; i < masks_.size(); ++i) {
      masks_[i].values.push_back(has(record, loop::all_slots[i]) ? 1 : 0);
    }
    for (std::size_t i = 0; i < columns_.size(); ++i) {
      auto& values = columns_[i].values;
      values.resize(values.size() + quantities_[i].units.size(), 0.0);
      if (has(record, quantities_[i].slot)) {
        quantities_[i].read(record, values.data() + values.size() - quantities_[i].units.size());
      }
    }
    if (++buffered_ == chunk_rows) flush();
  }

  void close() {
    flush();
    const auto close_all = [this](Dataset& dataset) { check(H5Dclose(dataset.id)); };
    close_all(tick_);
    close_all(t_);
    std::for_each(masks_.begin(), masks_.end(), close_all);
    std::for_each(columns_.begin(), columns_.end(), close_all);
    check(H5Fflush(file_, H5F_SCOPE_GLOBAL));
    check(H5Fclose(std::exchange(file_, H5I_INVALID_HID)));
  }

 private:
  struct Dataset {
    hid_t id = H5I_INVALID_HID;
    hsize_t columns = 0;  ///< 0: one-dimensional
    std::vector<double> values;
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

  void attribute(hid_t object, const char* name, const std::string& text) const {
    const hid_t type = check(H5Tcopy(H5T_C_S1));
    check(H5Tset_size(type, text.size() + 1));
    check(H5Tset_cset(type, H5T_CSET_UTF8));
    attribute(object, name, type, text.c_str());
    check(H5Tclose(type));
  }

  void attribute(hid_t object, const char* name, hid_t type, const void* value) const {
    const hid_t space = check(H5Screate(H5S_SCALAR));
    const hid_t id = check(H5Acreate2(object, name, type, space, H5P_DEFAULT, H5P_DEFAULT));
    check(H5Awrite(id, type, value));
    check(H5Aclose(id));
    check(H5Sclose(space));
  }

  void describe(const RunLog& log) const {
    const auto& info = log.info();
    const std::int64_t run = log.run();
    attribute(file_, "run_id", H5T_NATIVE_INT64, &run);
    attribute(file_, "num_ticks", H5T_NATIVE_INT64, &info.num_ticks);
    attribute(file_, "period_s", H5T_NATIVE_DOUBLE, &info.period_s);
    attribute(file_, "version", info.version);
    attribute(file_, "robot", info.robot);
    attribute(file_, "law", info.law);
    attribute(file_, "measurement", info.measurement);
    attribute(file_, "signals", info.signals);
    attribute(file_, "scenario", info.scenario);
    attribute(file_, "robot_description", info.robot_description);
  }

  Dataset create(const std::string& name, hid_t type, hsize_t columns, const std::string& unit,
                 const std::string& description) const {
    const int rank = columns == 0 ? 1 : 2;
    const std::array<hsize_t, 2> size = {0, columns};
    const std::array<hsize_t, 2> most = {H5S_UNLIMITED, columns};
    const std::array<hsize_t, 2> chunk = {chunk_rows, columns};
    const hid_t space = check(H5Screate_simple(rank, size.data(), most.data()));
    const hid_t properties = check(H5Pcreate(H5P_DATASET_CREATE));
    check(H5Pset_chunk(properties, rank, chunk.data()));
    Dataset dataset;
    dataset.columns = columns;
    dataset.id =
        check(H5Dcreate2(file_, name.c_str(), type, space, H5P_DEFAULT, properties, H5P_DEFAULT));
    dataset.values.reserve(chunk_rows * std::max<hsize_t>(columns, 1));
    check(H5Pclose(properties));
    check(H5Sclose(space));
    attribute(dataset.id, "unit", unit);
    attribute(dataset.id, "description", description);
    return dataset;
  }

  void write(Dataset& dataset) const {
    const int rank = dataset.columns == 0 ? 1 : 2;
    const std::array<hsize_t, 2> size = {written_ + buffered_, dataset.columns};
    const std::array<hsize_t, 2> start = {written_, 0};
    const std::array<hsize_t, 2> count = {buffered_, dataset.columns};
    check(H5Dset_extent(dataset.id, size.data()));
    const hid_t space = check(H5Dget_space(dataset.id));
    check(H5Sselect_hyperslab(space, H5S_SELECT_SET, start.data(), nullptr, count.data(), nullptr));
    const hid_t memory = check(H5Screate_simple(rank, count.data(), nullptr));
    check(
        H5Dwrite(dataset.id, H5T_NATIVE_DOUBLE, memory, space, H5P_DEFAULT, dataset.values.data()));
    check(H5Sclose(memory));
    check(H5Sclose(space));
    dataset.values.clear();
  }

  void flush() {
    if (buffered_ == 0) return;
    write(tick_);
    write(t_);
    for (auto& mask : masks_) write(mask);
    for (auto& column : columns_) write(column);
    written_ += std::exchange(buffered_, 0);
  }

  std::filesystem::path path_;
  const std::vector<Quantity>& quantities_;
  double period_s_;
  hid_t file_ = H5I_INVALID_HID;
  Dataset tick_, t_;
  std::array<Dataset, loop::num_slots> masks_;
  std::vector<Dataset> columns_;
  hsize_t written_ = 0;
  hsize_t buffered_ = 0;
};

Hdf5File::Hdf5File(const std::filesystem::path& path, const std::vector<Quantity>& quantities,
                   const RunLog& log)
    : impl_(std::make_unique<Impl>(path, quantities, log)) {}
Hdf5File::~Hdf5File() = default;
void Hdf5File::append(const TickRecord& record) { impl_->append(record); }
void Hdf5File::close() { impl_->close(); }

}  // namespace tachless::logger
