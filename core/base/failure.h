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
  protective_stop = 5,  ///< or a non-finite number
  interrupted = 130,
};

/// Ends a program with `code` and one line on stderr that says what, where and what to do: `what`
/// as one_line() gives it, since a name or a value in it may hold line ends.
class Failure : public std::runtime_error {
 public:
  Failure(ExitCode code, std::string_view what);
  /// `what` with its arguments, as fmt::format writes them.
  template <class First, class... Rest>
  Failure(ExitCode code, fmt::format_string<First, Rest...> what, First&& first, Rest&&... rest)
      : Failure(code, std::string_view(fmt::format(what, std::forward<First>(first),
                                                   std::forward<Rest>(rest)...))) {}
  [[nodiscard]] ExitCode code() const { return code_; }

 private:
  ExitCode code_;
};

/// Failure(ExitCode::bad_usage, …), the most frequent one.
Failure bad_usage(std::string_view what);
template <class First, class... Rest>
Failure bad_usage(fmt::format_string<First, Rest...> what, First&& first, Rest&&... rest) {
  return {ExitCode::bad_usage, what, std::forward<First>(first), std::forward<Rest>(rest)...};
}

/// The failure (exit code 2) of a program that the operating system refuses something that nothing
/// nearer to the call knows better words for, with what to do.
Failure system_failure(const std::system_error& error);

/// The exception being handled, as a Failure: itself if it is one, `system_failure` of a
/// std::system_error, otherwise with its words and ExitCode::protocol_violated, whatever its type.
/// To be called in a catch clause.
Failure current_failure();

/// For the catch clause of a `main`, of a std::exception: one line on stderr, and the exit code
/// that it returns. What is neither a Failure nor a refusal of the system is an internal error
/// (code 4).
/// @param evidence what a report of that should hold: "the command line"
int told_exception(std::string_view evidence);

}  // namespace tachless::base
