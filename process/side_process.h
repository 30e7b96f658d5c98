#pragma once

#include <chrono>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "process/child.h"

namespace tachless::process {

/// A program beside a run, on which the run does not depend: the 3D window. Its end does not stop
/// the run; the object's end stops it.
class SideProcess {
 public:
  using OnLine = std::function<void(std::string_view line)>;

  /// Starts `command`, a path and arguments, and waits until it has written the line `ready`.
  /// @param name for people  @param on_line is given what it writes from then on
  /// @throw diagnostics::Failure(bad_usage) with the last line it wrote when it ends instead, or is
  /// not ready within `limit`
  SideProcess(std::string name, const std::vector<std::string>& command, std::string_view ready,
              std::chrono::milliseconds limit, OnLine on_line);
  SideProcess(const SideProcess&) = delete;
  SideProcess& operator=(const SideProcess&) = delete;
  ~SideProcess();

  /// Passes its lines on, and notices its end. To be called regularly; does not wait.
  void attend();
  [[nodiscard]] bool running() const { return child_.running; }
  /// How it ended, in words; empty when it ended well.
  [[nodiscard]] const std::string& trouble() const { return trouble_; }

  /// Sends a signal, if it is running.
  void signal(int number) const;
  /// Ends it: SIGTERM, after a second SIGKILL.
  void stop();

 private:
  void end_group() const;

  std::string name_;
  OnLine on_line_;
  std::string last_line_;
  std::string trouble_;
  Child child_;
};

}  // namespace tachless::process
