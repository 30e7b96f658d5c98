#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

#include "base/file_descriptor.h"

/// Whole-file helpers: reading a file, writing a file so that no process reads an incomplete one,
/// and making a temporary directory. This header knows no format.
namespace tachless::base {

/// Longest text of a scenario or a URDF that is read, from files and from logs.
inline constexpr std::size_t max_text_bytes = 1'000'000;

/// Returns every byte of the file. Returns nothing if the file cannot be opened (errno says why) or
/// is a directory.
std::optional<std::string> file_text(const std::filesystem::path& path);

/// Returns every byte of a file that a user has named. `max_bytes`: 0 is no limit.
/// @throw Failure(bad_usage) with the file's name and why it cannot be read
std::string given_text(const std::filesystem::path& path, std::size_t max_bytes = 0);

/// A file that gets its name when it is complete. Until then, and if it never is, the earlier file
/// stays. The incomplete file has no name, and disappears if a signal ends the process. If the file
/// system needs a name, that name (X.1a2b3c4d.partial) is random and is created exclusively: two
/// writers of one file never share it. A pipe or a terminal is written to directly.
class UnfinishedFile {
 public:
  /// @param remedy what to do if the file cannot be written: "name another file with -o"
  /// @throw Failure(bad_usage) naming `path` if that is a directory or cannot be created there
  explicit UnfinishedFile(std::filesystem::path path, std::string_view remedy);
  UnfinishedFile(const UnfinishedFile&) = delete;
  UnfinishedFile& operator=(const UnfinishedFile&) = delete;
  ~UnfinishedFile();

  /// Returns the name to write to, for writers that open a file by its name.
  [[nodiscard]] const std::filesystem::path& name() const { return direct_ ? path_ : name_; }

  /// Writes all of the content, and finishes.
  /// @throw as `finish`
  void write(std::string_view content);
  /// Writes all of the content unless `path` exists by then.
  /// @return false if another writer was first; its file stays
  /// @throw as `finish`
  bool write_new(std::string_view content);
  /// Puts the complete and closed file in its place.
  /// @throw Failure(bad_usage) naming `path`, cause and remedy
  void finish();

  /// Throws the failure of a write.
  /// @throw Failure(bad_usage) "<path>: cannot be written: <cause>; <remedy>"
  [[noreturn]] void refuse(std::string_view cause) const;

 private:
  void write_all(std::string_view content);

  std::filesystem::path path_;
  std::filesystem::path name_;  ///< temporary, or of the descriptor; empty if complete
  FileDescriptor file_;
  std::string remedy_;
  bool direct_ = false;
};

/// A new empty directory, removed with the object.
class TemporaryDirectory {
 public:
  /// @param parent directory in which it is made; default: the system's directory for temporary
  /// files
  /// @throw Failure(bad_usage) if it cannot be made
  explicit TemporaryDirectory(const std::filesystem::path& parent = default_parent());
  TemporaryDirectory(const TemporaryDirectory&) = delete;
  TemporaryDirectory& operator=(const TemporaryDirectory&) = delete;
  ~TemporaryDirectory();

  [[nodiscard]] const std::filesystem::path& path() const { return path_; }

 private:
  static std::filesystem::path default_parent();

  std::filesystem::path path_;
};

}  // namespace tachless::base
