#pragma once

#include <sys/types.h>

#include <chrono>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "tests/support/temporary_directory.h"

/// A program, started as a user would start it, with stdout and stderr in its own files. The
/// destructor ends the program, by its id, if it still runs.
class Program {
 public:
  /// @param name tachless… is in build/…/bin; the shell's path finds any other program
  /// @param directory for the files of stdout and stderr
  Program(const std::string& name, const std::vector<std::string>& arguments,
          const std::filesystem::path& directory);
  ~Program();
  Program(const Program&) = delete;
  Program& operator=(const Program&) = delete;

  /// Waits for the end of the program.
  /// @return the exit code, or 128 + the signal that ended the program
  /// @throw std::runtime_error with its stderr if it still runs after `limit`
  int wait(std::chrono::seconds limit = std::chrono::seconds(240));
  /// Sends a signal to this process, never to a later one with its id. Any thread may call it.
  void signal(int number) const;
  [[nodiscard]] bool running() { return !ended(); }
  [[nodiscard]] pid_t pid() const { return pid_; }
  [[nodiscard]] std::string errors() const;
  [[nodiscard]] std::string output() const;
  /// Waits until stderr contains `text`.
  /// @throw std::runtime_error if that never happens
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

/// Returns the stdout of a program.
/// @throw std::runtime_error with its stderr if it fails
std::string output_of(const std::string& program, const std::vector<std::string>& arguments,
                      const TemporaryDirectory& directory);

/// Polls until the condition is true.
/// @throw std::runtime_error naming the condition after `limit`
void wait_until(const std::string& what, const std::function<bool()>& is_so,
                std::chrono::seconds limit = std::chrono::seconds(120));
