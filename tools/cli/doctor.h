#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "bus/lcm_url.h"
#include "session/statistics.h"

/// Checks of this machine for `doctor`. They change nothing.
namespace tachless::cli {

/// A bin of a histogram of durations.
struct Bin {
  double from_us = 0, to_us = 0;
  std::int64_t count = 0;
};

/// One line of `doctor`.
struct Finding {
  std::string subject;                     ///< "multicast", "receive buffer", …
  std::string what;                        ///< what was found
  std::optional<std::string> remedy = {};  ///< command that solves the problem; nothing: none
  bool warns = false;                      ///< the problem cannot be solved on this machine
  std::vector<Bin> bins = {};              ///< histogram of durations; empty: none

  [[nodiscard]] bool ok() const { return !remedy.has_value(); }
};

/// Checks everything that a run on the bus `lcm_url` uses, in about a second. The checks are about
/// the bus, its buffers and other publishers on it, private networks, real-time rights, clock, and
/// disk space of `directory`.
std::vector<Finding> examine(const std::string& lcm_url, const std::filesystem::path& directory);

/// Returns the causes of late ticks that the user can remove: real-time rights, locked memory,
/// clock.
std::vector<Finding> examine_punctuality();

/// Return the finding for a single figure.
/// @param interface through which messages to the bus leave; empty if there is none
Finding judge_ttl(const bus::LcmUrl& url, const std::string& interface);
Finding judge_receive_buffer(long rmem_max_bytes);
Finding judge_clock_source(const std::string& source);
/// @param proc_stat the content of /proc/stat
Finding judge_stolen_time(const std::string& proc_stat);
Finding judge_disk(std::uintmax_t free_bytes, const std::filesystem::path& directory);

/// Returns the bins 1, 2, 5, 10, … us from the first to the last duration, empty ones included. A
/// bucket that is in two bins counts in the first one, so that an edge has the width of a bucket, a
/// sixteenth.
std::vector<Bin> bins_of(const std::vector<session::LatencyHistogram::Bucket>& buckets);
/// Returns a line for each bin: its edges, its count, and a bar.
std::string text(const std::vector<Bin>& bins);

}  // namespace tachless::cli
