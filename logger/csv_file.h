#pragma once

#include <cstdio>
#include <filesystem>
#include <string>
#include <vector>

#include "logger/table.h"

namespace tachless::logger {

/// Comma-separated values: a header line, then a line per tick. Numbers are written so that they
/// read back the same (%.17g); what is missing is an empty cell.
class CsvFile {
 public:
  /// Overwrites `path`; `-` is standard output, to which is added.
  /// @throw diagnostics::Failure(bad_usage) when it cannot be written, here and below
  CsvFile(const std::filesystem::path& path, const std::vector<Quantity>& quantities,
          double period_s);
  CsvFile(const CsvFile&) = delete;
  CsvFile& operator=(const CsvFile&) = delete;
  ~CsvFile();

  void append(const TickRecord& record);
  void close();

 private:
  [[noreturn]] void fail(int error) const;
  void write();

  std::filesystem::path path_;
  const std::vector<Quantity>& quantities_;
  double period_s_;
  std::FILE* file_ = nullptr;
  std::vector<char> block_;  ///< written at once when no further row is sure to fit
  std::size_t filled_ = 0;
  std::size_t longest_row_ = 0;
};

}  // namespace tachless::logger
