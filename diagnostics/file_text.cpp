#include "diagnostics/file_text.h"

#include <fmt/format.h>

#include <cerrno>
#include <cstring>
#include <fstream>
#include <iterator>

#include "diagnostics/failure.h"

namespace tachless::diagnostics {

std::optional<std::string> file_text(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file || std::filesystem::is_directory(path)) return {};
  return std::string(std::istreambuf_iterator<char>(file), {});
}

std::string given_text(const std::filesystem::path& path, std::size_t max_bytes) {
  const auto refuse = [&](const std::string& why) {
    return Failure(ExitCode::bad_usage, path.string() + ": " + why);
  };
  std::error_code error;
  const auto status = std::filesystem::status(path, error);
  if (status.type() == std::filesystem::file_type::not_found) throw refuse("no such file");
  if (std::filesystem::is_directory(status)) throw refuse("is a directory; allowed: a file");
  // It may be read again, by each program of a run, and a pipe would be waited for.
  if (std::filesystem::exists(status) && !std::filesystem::is_regular_file(status)) {
    throw refuse("is a pipe or a device; allowed: a file");
  }
  const auto size = std::filesystem::file_size(path, error);
  if (!error && max_bytes > 0 && size > max_bytes) {
    throw refuse(fmt::format("too large; allowed: at most {} bytes", max_bytes));
  }
  errno = 0;
  auto text = file_text(path);
  if (!text) {
    const int cause = errno;
    throw refuse(fmt::format("cannot be read: {}; {}", std::strerror(cause),
                             cause == EMFILE || cause == ENFILE
                                 ? "allow more open files, for example: ulimit -n 1024"
                                 : "see its permissions"));
  }
  return std::move(*text);
}

}  // namespace tachless::diagnostics
