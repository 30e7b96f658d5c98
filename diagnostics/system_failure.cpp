#include "diagnostics/system_failure.h"

#include <fmt/format.h>

#include <string_view>

namespace tachless::diagnostics {
namespace {

std::string_view remedy(const std::error_code& code) {
  if (code == std::errc::too_many_files_open || code == std::errc::too_many_files_open_in_system) {
    return "allow more open files, for example: ulimit -n 1024";
  }
  if (code == std::errc::not_enough_memory) return "free some memory";
  if (code == std::errc::resource_unavailable_try_again) {
    return "allow more processes and threads (ulimit -u), or end some";
  }
  if (code == std::errc::no_space_on_device) return "free some space on that disk";
  return "`tachless doctor` looks at what a run needs";
}

}  // namespace

Failure system_failure(const std::system_error& error) {
  return {ExitCode::bad_usage,
          fmt::format("the system refuses: {}; {}", error.what(), remedy(error.code()))};
}

}  // namespace tachless::diagnostics
