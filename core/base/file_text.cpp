#include "base/file_text.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iterator>
#include <system_error>
#include <utility>

#include "base/failure.h"

namespace tachless::base {

namespace fs = std::filesystem;

std::optional<std::string> file_text(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file || fs::is_directory(path)) return {};
  return std::string(std::istreambuf_iterator<char>(file), {});
}

std::string given_text(const fs::path& path, std::size_t max_bytes) {
  const auto refuse = [&](const std::string& why) {
    return Failure(ExitCode::bad_usage, path.string() + ": " + why);
  };
  std::error_code error;
  const auto status = fs::status(path, error);
  if (status.type() == fs::file_type::not_found) throw refuse("no such file");
  if (fs::is_directory(status)) throw refuse("is a directory; allowed: a file");
  // It may be read again, by each program of a run, and a pipe would be waited for.
  if (fs::exists(status) && !fs::is_regular_file(status)) {
    throw refuse("is a pipe or a device; allowed: a file");
  }
  const auto size = fs::file_size(path, error);
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

UnfinishedFile::UnfinishedFile(fs::path path, std::string_view remedy)
    : path_(std::move(path)), remedy_(remedy) {
  std::error_code error;
  const fs::file_status status = fs::status(path_, error);
  if (fs::is_directory(status)) refuse("it is a directory");
  direct_ = fs::exists(status) && !fs::is_regular_file(status);
  if (direct_) return;
  partial_ = path_.string() + ".partial";
  // Created here and by this process alone: what has the name already, a link to another file
  // perhaps, is removed and not written through.
  ::unlink(partial_.c_str());
  const int created = ::open(partial_.c_str(), O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0666);
  if (created < 0) refuse(std::strerror(errno));
  ::close(created);
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

TemporaryDirectory::TemporaryDirectory(const fs::path& parent) {
  std::string name = (parent / "tachless-XXXXXX").string();
  if (mkdtemp(name.data()) == nullptr) {
    throw bad_usage("{}: no directory can be made there; set TMPDIR", name);
  }
  path_ = name;
}

TemporaryDirectory::~TemporaryDirectory() {
  std::error_code ignored;
  fs::remove_all(path_, ignored);
}

}  // namespace tachless::base
