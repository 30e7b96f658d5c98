#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "bus/lcm_url.h"

/// What `doctor` finds out about this machine. Changes and mends nothing.
namespace tachless::cli {

/// One line of `doctor`.
struct Finding {
  std::string subject;                     ///< "multicast", "receive buffer", …
  std::string what;                        ///< what was found
  std::optional<std::string> remedy = {};  ///< what to type; nothing: all is well

  [[nodiscard]] bool ok() const { return !remedy.has_value(); }
};

/// Looks at everything that a run of this machine on the bus `lcm_url` needs or would like: the
/// bus, its buffers and other publishers on it, private networks, real-time rights, clock, disk
/// space of `directory`. Takes about a second, changes nothing.
std::vector<Finding> examine(const std::string& lcm_url, const std::filesystem::path& directory);

/// What is not well with this machine's punctuality: real-time rights, clock, time that a host
/// takes.
std::vector<Finding> examine_punctuality();

/// The judgement on single figures.
/// @param interface the one that messages to the bus leave by; empty if there is none
Finding judge_ttl(const bus::LcmUrl& url, const std::string& interface);
Finding judge_receive_buffer(long rmem_max_bytes);
Finding judge_clock_source(const std::string& source);
/// @param proc_stat the content of /proc/stat
Finding judge_stolen_time(const std::string& proc_stat);
Finding judge_disk(std::uintmax_t free_bytes, const std::filesystem::path& directory);

}  // namespace tachless::cli
