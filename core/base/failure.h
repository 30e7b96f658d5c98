#pragma once

#include <fmt/core.h>

#include <stdexcept>
#include <string_view>
#include <system_error>
#include <utility>

namespace tachless::base {

/// Exit codes of every program.
enum class ExitCode : int {
  done = 0,
  check_said_no = 1,
  bad_usage = 2,  ///< bad options or scenario
  peer_lost = 3,
  protocol_violated = 4,
  protective_stop = 5,  ///< protective stop, or a number that is not finite
  interrupted = 130,
};

/// Error that ends a program with `code` and one line on stderr. The line names the failure, its
/// place and the remedy. one_line() removes the line ends of names and values.
class Failure : public std::runtime_error {
 public:
  Failure(ExitCode code, std::string_view what);
  /// Formats `what` with its arguments by fmt::format.
  template <class First, class... Rest>
  Failure(ExitCode code, fmt::format_string<First, Rest...> what, First&& first, Rest&&... rest)
      : Failure(code, std::string_view(fmt::format(what, std::forward<First>(first),
                                                   std::forward<Rest>(rest)...))) {}
  [[nodiscard]] ExitCode code() const { return code_; }

 private:
  ExitCode code_;
};

/// Returns a Failure with ExitCode::bad_usage.
Failure bad_usage(std::string_view what);
template <class First, class... Rest>
Failure bad_usage(fmt::format_string<First, Rest...> what, First&& first, Rest&&... rest) {
  return {ExitCode::bad_usage, what, std::forward<First>(first), std::forward<Rest>(rest)...};
}

/// Turns a system error that no caller has explained into a Failure (exit code 2) with a remedy.
Failure system_failure(const std::system_error& error);

/// Returns the exception being handled as a Failure. A std::system_error goes through
/// `system_failure`; any other exception keeps its words and gets ExitCode::protocol_violated. Call
/// it in a catch clause.
Failure current_failure();

/// Prints the std::exception being handled on one line of stderr and returns the exit code. Call it
/// in the catch clause of `main`. An exception that is neither a Failure nor a system error is an
/// internal error (code 4).
/// @param evidence what a report of an internal error should contain: "the command line"
int told_exception(std::string_view evidence);

}  // namespace tachless::base
