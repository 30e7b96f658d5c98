#pragma once

#include <system_error>

#include "diagnostics/failure.h"

namespace tachless::diagnostics {

/// The failure (exit code 2) of a program that the operating system refuses something that nothing
/// nearer to the call knows better words for, with what to do.
Failure system_failure(const std::system_error& error);

}  // namespace tachless::diagnostics
