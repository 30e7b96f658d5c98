#pragma once

#include <stdexcept>
#include <string_view>

namespace tachless::diagnostics {

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
  [[nodiscard]] ExitCode code() const { return code_; }

 private:
  ExitCode code_;
};

}  // namespace tachless::diagnostics
