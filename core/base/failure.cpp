#include "base/failure.h"

#include <fmt/format.h>

#include <exception>
#include <new>

#include "base/logging.h"
#include "base/text.h"

namespace tachless::base {
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
  return "run tachless doctor: it examines what a run needs";
}

/// Returns the failure of a process that gets no more memory.
Failure memory_failure() {
  return {ExitCode::bad_usage,
          "there is not enough memory; free some, or allow more: ulimit -v unlimited"};
}

}  // namespace

Failure::Failure(ExitCode code, std::string_view what)
    : std::runtime_error(printable(one_line(what))), code_(code) {}

Failure bad_usage(std::string_view what) { return {ExitCode::bad_usage, what}; }

Failure system_failure(const std::system_error& error) {
  return bad_usage("system error: {}; {}", error.what(), remedy(error.code()));
}

Failure current_failure() {
  try {
    throw;
  } catch (const Failure& failure) {
    return failure;
  } catch (const std::system_error& error) {
    return system_failure(error);
  } catch (const std::bad_alloc&) {
    return memory_failure();
  } catch (const std::exception& error) {
    return {ExitCode::protocol_violated, error.what()};
  } catch (...) {
    return {ExitCode::protocol_violated,
            "internal error: an exception was thrown that is no std::exception"};
  }
}

int told_exception(std::string_view evidence) {
  const auto tell = [](const Failure& failure) {
    log_error(failure.what());
    return static_cast<int>(failure.code());
  };
  try {
    throw;
  } catch (const Failure& failure) {
    return tell(failure);
  } catch (const std::system_error& error) {
    return tell(system_failure(error));
  } catch (const std::bad_alloc&) {
    return tell(memory_failure());
  } catch (const std::exception& error) {
    return tell(
        {ExitCode::protocol_violated, fmt::format("internal error: {}; please report it with {}",
                                                  one_line(error.what()), evidence)});
  }
}

}  // namespace tachless::base
