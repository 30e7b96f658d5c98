#pragma once

#include <string_view>
#include <system_error>

#include "diagnostics/failure.h"

namespace tachless::diagnostics {

/// The failure (exit code 2) of a program that the operating system refuses something that nothing
/// nearer to the call knows better words for, with what to do.
Failure system_failure(const std::system_error& error);

/// For the catch clause of a `main`, of a std::exception: one line on stderr, and the exit code
/// that it returns. What is neither a Failure nor a refusal of the system is an internal error
/// (code 4).
/// @param evidence what a report of that should hold: "the command line"
int told_exception(std::string_view evidence);

}  // namespace tachless::diagnostics
