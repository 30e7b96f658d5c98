#pragma once

#include <sys/types.h>

#include <chrono>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "tests/support/temporary_directory.h"

/// A program, started as a user would start it, with stdout and stderr in files of its own. Ended
/// with the object, by its id, should it still run.
class Program {
 public:
  /// `name`: tachless… is in build/…/bin, everything else where the shell would find it.
  /// `directory`: where its stdout and stderr go.
  Program(const std::string& name, const std::vector<std::string>& arguments,
          const std::filesystem::path& directory);
  ~Program();
  Program(const Program&) = delete;
  Program& operator=(const Program&) = delete;

  /// Exit code, or 128 + the signal that ended it.
  /// @throw std::runtime_error with its stderr when it still runs after `limit`.
  int wait(std::chrono::seconds limit = std::chrono::seconds(240));
  /// To this process, never to a later one of its id. From any thread.
  void signal(int number) const;
  [[nodiscard]] bool running() { return !ended(); }
  [[nodiscard]] pid_t pid() const { return pid_; }
  [[nodiscard]] std::string errors() const;
  [[nodiscard]] std::string output() const;
  /// Waits until stderr contains `text`. @throw std::runtime_error when that never happens.
  void wait_for(const std::string& text, std::chrono::seconds limit = std::chrono::seconds(240));

 private:
  bool ended();

  std::string name_;
  std::filesystem::path stderr_path_;
  std::filesystem::path stdout_path_;
  pid_t pid_ = -1;
  int pidfd_ = -1;
  bool running_ = true;
  int exit_code_ = -1;
};

std::string contents(const std::filesystem::path& path);

/// The stdout of a program. @throw std::runtime_error with its stderr when it fails.
std::string output_of(const std::string& program, const std::vector<std::string>& arguments,
                      const TemporaryDirectory& directory);

/// Looks until it is so. @throw std::runtime_error naming what was waited for after `limit`.
void wait_until(const std::string& what, const std::function<bool()>& is_so,
                std::chrono::seconds limit = std::chrono::seconds(120));
