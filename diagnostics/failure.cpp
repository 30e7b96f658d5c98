#include "diagnostics/failure.h"

#include "diagnostics/text.h"

namespace tachless::diagnostics {

Failure::Failure(ExitCode code, std::string_view what)
    : std::runtime_error(printable(one_line(what))), code_(code) {}

Failure bad_usage(std::string_view what) { return {ExitCode::bad_usage, what}; }

}  // namespace tachless::diagnostics
