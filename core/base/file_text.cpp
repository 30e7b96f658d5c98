#include "base/file_text.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iterator>
#include <random>
#include <system_error>
#include <utility>

#include "base/failure.h"
#include "base/text.h"

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
  // Each program of a run may read the file again; a pipe would block the second reader.
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
  std::random_device random;
  do {
    name_ = fmt::format("{}.{:08x}.partial", path_.string(), random());
    file_ = FileDescriptor(::open(name_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666));
  } while (file_.get() < 0 && errno == EEXIST);
  if (file_.get() < 0) {
    const int cause = errno;
    name_.clear();
    if (cause == ENOENT) remedy_ = "type: mkdir -p " + shell_word(path_.parent_path().string());
    refuse(std::strerror(cause));
  }
}

UnfinishedFile::~UnfinishedFile() {
  std::error_code ignored;
  if (!name_.empty()) fs::remove(name_, ignored);
}

void UnfinishedFile::write_all(std::string_view content) {
  if (direct_) file_ = FileDescriptor(::open(path_.c_str(), O_WRONLY | O_CLOEXEC));
  if (file_.get() < 0) refuse(std::strerror(errno));
  while (!content.empty()) {
    const ssize_t written = ::write(file_.get(), content.data(), content.size());
    if (written < 0 && errno != EINTR) refuse(std::strerror(errno));
    if (written > 0) content.remove_prefix(static_cast<std::size_t>(written));
  }
}

void UnfinishedFile::write(std::string_view content) {
  write_all(content);
  finish();
}

bool UnfinishedFile::write_new(std::string_view content) {
  write_all(content);
  if (direct_ || ::link(name_.c_str(), path_.c_str()) == 0) return true;
  if (errno == EEXIST) return false;
  finish();  // the file system has no hard links
  return true;
}

void UnfinishedFile::finish() {
  if (direct_) return;
  std::error_code error;
  fs::rename(name_, path_, error);
  if (error) refuse(error.message());
  name_.clear();
}

void UnfinishedFile::refuse(std::string_view cause) const {
  throw Failure(ExitCode::bad_usage,
                fmt::format("{}: cannot be written: {}; {}", path_.string(), cause, remedy_));
}

fs::path TemporaryDirectory::default_parent() {
  std::error_code error;
  fs::path parent = fs::temp_directory_path(error);
  if (!error) return parent;
  throw bad_usage("{}: no directory for temporary files; set TMPDIR", parent.string());
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
