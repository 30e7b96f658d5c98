#include "diagnostics/unfinished_file.h"

#include <fmt/format.h>

#include <cerrno>
#include <cstring>
#include <fstream>
#include <system_error>
#include <utility>

#include "diagnostics/failure.h"

namespace tachless::diagnostics {

namespace fs = std::filesystem;

UnfinishedFile::UnfinishedFile(fs::path path, std::string_view remedy)
    : path_(std::move(path)), remedy_(remedy) {
  std::error_code error;
  const fs::file_status status = fs::status(path_, error);
  if (fs::is_directory(status)) refuse("it is a directory");
  direct_ = fs::exists(status) && !fs::is_regular_file(status);
  if (direct_) return;
  partial_ = path_.string() + ".partial";
  const fs::path directory = path_.has_parent_path() ? path_.parent_path() : ".";
  if (!fs::is_directory(directory, error)) refuse(std::strerror(ENOENT));
}

UnfinishedFile::~UnfinishedFile() {
  std::error_code ignored;
  if (!direct_) fs::remove(partial_, ignored);
}

void UnfinishedFile::write(std::string_view content) {
  errno = 0;
  std::ofstream file(name(), std::ios::binary);
  file.write(content.data(), static_cast<std::streamsize>(content.size()));
  file.close();
  if (!file) refuse(std::strerror(errno));
  finish();
}

void UnfinishedFile::finish() {
  if (direct_) return;
  std::error_code error;
  fs::rename(partial_, path_, error);
  if (error) refuse(error.message());
}

void UnfinishedFile::refuse(std::string_view cause) const {
  throw Failure(ExitCode::bad_usage,
                fmt::format("{}: cannot be written: {}; {}", path_.string(), cause, remedy_));
}

}  // namespace tachless::diagnostics
