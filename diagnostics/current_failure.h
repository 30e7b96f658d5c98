#pragma once

#include "diagnostics/failure.h"

namespace tachless::diagnostics {

/// The exception being handled, as a Failure: itself if it is one, otherwise with its words and
/// ExitCode::protocol_violated, whatever its type. To be called in a catch clause.
Failure current_failure();

}  // namespace tachless::diagnostics
