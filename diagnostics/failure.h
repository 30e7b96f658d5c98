#pragma once

#include <stdexcept>
#include <string>

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

/// Ends a program with `code` and one line on stderr that says what, where and what to do. Line
/// ends in `what` (a name or a value may hold them) become spaces.
class Failure : public std::runtime_error {
 public:
  Failure(ExitCode code, const std::string& what)
      : std::runtime_error(on_one_line(what)), code_(code) {}
  [[nodiscard]] ExitCode code() const { return code_; }

 private:
  static std::string on_one_line(std::string text) {
    for (char& c : text) {
      if (c == '\n' || c == '\r') c = ' ';
    }
    return text;
  }

  ExitCode code_;
};

}  // namespace tachless::diagnostics
