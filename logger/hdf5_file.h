#pragma once

#include <filesystem>
#include <memory>
#include <vector>

#include "logger/run_log.h"
#include "logger/table.h"

namespace tachless::logger {

/// One HDF5 dataset per quantity, ticks x joints, with attributes `unit`, `description` and
/// `present`: the path of the mask (ticks, 0 or 1) that tells in which rows it has values. Rows
/// without are zero. The file's attributes are scenario, robot_description, run_id, version and
/// what else RUN_INFO says.
class Hdf5File {
 public:
  /// Overwrites `path`.
  /// @throw diagnostics::Failure(bad_usage) when it cannot be written, here and below
  Hdf5File(const std::filesystem::path& path, const std::vector<Quantity>& quantities,
           const RunLog& log);
  Hdf5File(const Hdf5File&) = delete;
  Hdf5File& operator=(const Hdf5File&) = delete;
  ~Hdf5File();

  void append(const TickRecord& record);
  void close();

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tachless::logger
