#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

/// Files as a whole: what is in one, and one that is there when it is whole; a temporary directory.
/// Knows no format.
namespace tachless::base {

/// Longest text of a scenario or a URDF that is read, from files and from logs.
inline constexpr std::size_t max_text_bytes = 1'000'000;

/// All that is in the file, to the byte; nothing when it cannot be opened or is a directory (errno
/// then says why it cannot be opened).
std::optional<std::string> file_text(const std::filesystem::path& path);

/// The same of a file that a user has named. `max_bytes`: 0 is no limit.
/// @throw Failure(bad_usage) with the file's name and why it cannot be read
std::string given_text(const std::filesystem::path& path, std::size_t max_bytes = 0);

/// A file that is written under another name (X.partial) and renamed when it is complete: until
/// then, and if it never is, the earlier file stays. The other name is created exclusively: no link
/// that somebody has put there is followed. A pipe or a terminal is written to directly.
class UnfinishedFile {
 public:
  /// @param remedy what to do when it cannot be written: "name another file with -o"
  /// @throw Failure(bad_usage) naming `path` when that is a directory, or cannot be created there
  explicit UnfinishedFile(std::filesystem::path path, std::string_view remedy);
  UnfinishedFile(const UnfinishedFile&) = delete;
  UnfinishedFile& operator=(const UnfinishedFile&) = delete;
  ~UnfinishedFile();

  /// The name to write to.
  [[nodiscard]] const std::filesystem::path& name() const { return direct_ ? path_ : partial_; }

  /// Writes all of the content, and finishes. @throw as `finish`
  void write(std::string_view content);
  /// Puts the file, which is whole and closed, in its place.
  /// @throw Failure(bad_usage) naming `path`, cause and remedy
  void finish();

  /// @throw Failure(bad_usage) naming `path` and remedy: "<path>: cannot be written: <cause>;
  /// <remedy>"
  [[noreturn]] void refuse(std::string_view cause) const;

 private:
  std::filesystem::path path_;
  std::filesystem::path partial_;
  std::string remedy_;
  bool direct_ = false;
};

/// A new empty directory, removed with the object.
class TemporaryDirectory {
 public:
  /// @throw Failure(bad_usage) when it cannot be made
  explicit TemporaryDirectory(
      const std::filesystem::path& parent = std::filesystem::temp_directory_path());
  TemporaryDirectory(const TemporaryDirectory&) = delete;
  TemporaryDirectory& operator=(const TemporaryDirectory&) = delete;
  ~TemporaryDirectory();

  [[nodiscard]] const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

}  // namespace tachless::base
