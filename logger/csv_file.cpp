#include "logger/csv_file.h"

#include <array>
#include <cerrno>
#include <system_error>
#include <utility>

#include "diagnostics/failure.h"
#include "diagnostics/text.h"

namespace tachless::logger {
namespace {

void append_number(std::string& line, double value) {
  std::array<char, 32> text;
  const int length = std::snprintf(text.data(), text.size(), "%.17g", value);
  line.append(text.data(), static_cast<std::size_t>(length));
}

}  // namespace

CsvFile::CsvFile(const std::filesystem::path& path, const std::vector<Quantity>& quantities,
                 double period_s)
    : path_(path), quantities_(quantities), period_s_(period_s) {
  file_ = std::fopen(path.c_str(), "we");
  if (file_ == nullptr) fail(errno);
  line_ = "tick,t_s";
  for (const auto& quantity : quantities_) {
    for (std::size_t i = 0; i < quantity.units.size(); ++i) {
      line_.append(1, ',').append(diagnostics::csv_field(quantity.column(i)));
    }
  }
  write(line_);
}

CsvFile::~CsvFile() {
  if (file_ != nullptr) std::fclose(file_);
}

void CsvFile::append(const TickRecord& record) {
  line_ = std::to_string(record.tick);
  line_ += ',';
  append_number(line_, static_cast<double>(record.tick) * period_s_);
  std::array<double, robot::max_joints> values;
  for (const auto& quantity : quantities_) {
    const bool present = has(record, quantity.slot);
    if (present) quantity.read(record, values.data());
    for (std::size_t i = 0; i < quantity.units.size(); ++i) {
      line_ += ',';
      if (present) append_number(line_, values[i]);
    }
  }
  write(line_);
}

void CsvFile::write(const std::string& line) {
  if (std::fwrite(line.data(), 1, line.size(), file_) != line.size() ||
      std::fputc('\n', file_) == EOF) {
    fail(errno);
  }
}

void CsvFile::close() {
  if (std::fclose(std::exchange(file_, nullptr)) != 0) fail(errno);
}

void CsvFile::fail(int error) const {
  throw diagnostics::Failure(
      diagnostics::ExitCode::bad_usage,
      path_.string() + ": cannot write: " + std::generic_category().message(error) +
          (error == ENOSPC ? "; free some space, or name a file on another disk"
                           : "; name another file"));
}

}  // namespace tachless::logger
