#pragma once

#include <sys/types.h>

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace tachless::process {

/// Processes that `pid`'s main thread has started and not yet waited for; none when it is gone.
std::vector<pid_t> children_of(pid_t pid);

/// Its threads; none when it is gone.
std::vector<pid_t> threads_of(pid_t pid);

/// Whether it holds a socket; no when it is gone.
bool has_socket(pid_t pid);

/// File name of the program that it runs ("tachless-plant"); empty when it is gone.
std::string program_of(pid_t pid);

/// Memory that it occupies [KiB]; nothing when it has ended.
std::optional<std::int64_t> resident_kib(pid_t pid);

}  // namespace tachless::process
