#include "logger/csv_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <system_error>
#include <utility>

#include "diagnostics/failure.h"
#include "diagnostics/text.h"
#include "logger/number_text.h"

namespace tachless::logger {
namespace {

constexpr std::size_t block_bytes = 1 << 18;

}  // namespace

CsvFile::CsvFile(const std::filesystem::path& path, const std::vector<Quantity>& quantities,
                 double period_s)
    : path_(path), quantities_(quantities), period_s_(period_s) {
  file_ = path == "-" ? ::fdopen(::fcntl(STDOUT_FILENO, F_DUPFD_CLOEXEC, 0), "w")
                      : std::fopen(path.c_str(), "we");
  if (file_ == nullptr) fail(errno);
  std::string head = "tick,t_s";
  std::size_t columns = 2;
  for (const auto& quantity : quantities_) {
    for (std::size_t i = 0; i < quantity.units.size(); ++i) {
      head.append(1, ',').append(diagnostics::csv_field(quantity.column(i)));
    }
    columns += quantity.units.size();
  }
  head += '\n';
  longest_row_ = columns * (longest_number + 1);
  block_.resize(std::max(block_bytes, head.size() + longest_row_));
  filled_ = head.copy(block_.data(), head.size());
}

CsvFile::~CsvFile() {
  if (file_ != nullptr) std::fclose(file_);
}

void CsvFile::append(const TickRecord& record) {
  if (block_.size() - filled_ < longest_row_) write();
  char* at = &block_[filled_];
  at = std::to_chars(at, at + longest_number, record.tick).ptr;
  *at++ = ',';
  at = write_number(at, static_cast<double>(record.tick) * period_s_);
  std::array<double, robot::max_joints> values;
  for (const auto& quantity : quantities_) {
    const bool present = has(record, quantity.slot);
    if (present) quantity.read(record, values.data());
    for (std::size_t i = 0; i < quantity.units.size(); ++i) {
      *at++ = ',';
      if (present) at = write_number(at, values[i]);
    }
  }
  *at++ = '\n';
  filled_ = static_cast<std::size_t>(at - block_.data());
}

void CsvFile::write() {
  if (std::fwrite(block_.data(), 1, filled_, file_) != filled_) fail(errno);
  filled_ = 0;
}

void CsvFile::close() {
  write();
  if (std::fclose(std::exchange(file_, nullptr)) != 0) fail(errno);
}

void CsvFile::fail(int error) const {
  throw diagnostics::bad_usage(
      path_.string() + ": cannot write: " + std::generic_category().message(error) +
      (error == ENOSPC ? "; free some space, or name a file on another disk"
                       : "; name another file"));
}

}  // namespace tachless::logger
