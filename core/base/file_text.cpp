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

namespace {

// A file without a name has the name of its descriptor here. Such a file vanishes with its process,
// whatever ends that. Not every file system has files without a name.
constexpr const char* open_files = "/proc/self/fd/";

bool is_unnamed(const fs::path& name) { return name.string().starts_with(open_files); }

bool link_as(const fs::path& name, const fs::path& other) {
  return linkat(AT_FDCWD, name.c_str(), AT_FDCWD, other.c_str(), AT_SYMLINK_FOLLOW) == 0;
}

/// Returns a random name beside `path` that no file has and that `take` has taken. Returns an empty
/// one if `take` fails, also with EEXIST for name after name: 100 of 4 billion are not all taken.
template <class Take>
std::string new_name(const fs::path& path, Take take) {
  std::random_device random;
  constexpr int most_names = 100;
  for (int k = 0; k < most_names; ++k) {
    std::string name = fmt::format("{}.{:08x}.partial", path.string(), random());
    if (take(name)) return name;
    if (errno != EEXIST) return {};
  }
  return {};
}

}  // namespace

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
  const fs::path folder = path_.has_parent_path() ? path_.parent_path() : fs::path(".");
  file_ = FileDescriptor(::open(folder.c_str(), O_TMPFILE | O_WRONLY | O_CLOEXEC, 0666));
  name_ = open_files + std::to_string(file_.get());
  if (file_.get() >= 0 && ::access(name_.c_str(), F_OK) == 0) return;
  const auto create = [&](const std::string& name) {
    file_ = FileDescriptor(::open(name.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666));
    return file_.get() >= 0;
  };
  name_ = new_name(path_, create);
  if (!name_.empty()) return;
  const int cause = errno;
  if (cause == ENOENT) remedy_ = "type: mkdir -p " + shell_word(path_.parent_path().string());
  refuse(std::strerror(cause));
}

UnfinishedFile::~UnfinishedFile() {
  std::error_code ignored;
  if (!name_.empty() && !is_unnamed(name_)) fs::remove(name_, ignored);
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
  if (direct_ || link_as(name_, path_)) return true;
  if (errno == EEXIST) return false;
  finish();  // the file system has no hard links
  return true;
}

void UnfinishedFile::finish() {
  if (direct_) return;
  if (is_unnamed(name_)) {  // a link does not replace a file
    const std::string name =
        new_name(path_, [&](const std::string& free) { return link_as(name_, free); });
    if (name.empty()) refuse(std::strerror(errno));
    name_ = name;
  }
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
