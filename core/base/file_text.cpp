#include "base/file_text.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
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
  name_ = path_;
  if (fs::exists(status) && !fs::is_regular_file(status)) return;
  const fs::path directory = path_.has_parent_path() ? path_.parent_path() : fs::path(".");
  file_ = FileDescriptor(::open(directory.c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, 0666));
  if (file_.get() < 0) create_partial();
  // Not by its name in the directory, which may come to mean another file.
  name_ = fmt::format("/proc/self/fd/{}", file_.get());
}

void UnfinishedFile::create_partial() {
  std::string unique = path_.string() + ".XXXXXX.partial";
  file_ = FileDescriptor(mkostemps(unique.data(), std::strlen(".partial"), O_CLOEXEC));
  if (file_.get() < 0) refuse(std::strerror(errno));
  partial_ = unique;
  const mode_t mask = umask(0);  // mkostemps gives the owner alone rights
  umask(mask);
  fchmod(file_.get(), 0666 & ~mask);
}

UnfinishedFile::~UnfinishedFile() {
  if (!partial_.empty()) ::unlink(partial_.c_str());
}

void UnfinishedFile::write(std::string_view content) {
  errno = 0;
  std::ofstream file(name_, std::ios::binary);
  file.write(content.data(), static_cast<std::streamsize>(content.size()));
  file.close();
  if (!file) refuse(std::strerror(errno));
  finish();
}

void UnfinishedFile::finish() {
  if (file_.get() < 0) return;
  for (int number = 0; partial_.empty(); ++number) {
    const fs::path unique = fmt::format("{}.{}-{}.partial", path_.string(), getpid(), number);
    if (linkat(AT_FDCWD, name_.c_str(), AT_FDCWD, unique.c_str(), AT_SYMLINK_FOLLOW) == 0) {
      partial_ = unique;
    } else if (errno != EEXIST) {
      refuse(std::strerror(errno));
    }
  }
  std::error_code error;
  fs::rename(partial_, path_, error);
  if (error) refuse(error.message());
  partial_.clear();
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
