#pragma once

#include <cstdint>
#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "logger/log_file.h"
#include "logger/run_log.h"

/// What is in a log, at a glance: any LCM log, ours or not, damaged or not.
namespace tachless::logger {

struct ChannelInfo {
  std::string name;
  std::uint64_t messages = 0;
  std::uint64_t bytes = 0;       ///< of data
  std::string type;              ///< "tachless.tick_t"; empty when the type is not ours
  std::uint64_t other_type = 0;  ///< messages of another type than the first one
  std::int64_t first_utime = 0;  ///< event time stamps [us]
  std::int64_t last_utime = 0;
  std::int64_t longest_silence_us = 0;  ///< between two messages that follow each other

  /// Messages per second by their time stamps; nothing with fewer than two or no time between.
  [[nodiscard]] std::optional<double> rate_hz() const;
};

/// The run a log recorded, when it is one of ours.
struct RunFacts {
  std::int64_t run = 0;
  std::string scenario;
  std::string robot;  ///< channel prefix
  std::string law;
  std::string measurement;
  std::string mode;
  std::string version;
  double period_s = 0;
  std::int64_t num_ticks = 0;  ///< as planned
  int num_joints = 0;
  bool flexible = false;
  RunSummary summary;
};

struct LogInfo {
  static constexpr std::size_t max_channels = 1000;

  std::filesystem::path path;
  std::uint64_t size_bytes = 0;
  std::uint64_t events = 0;
  std::int64_t first_utime = 0;  ///< smallest and largest time stamp [us]
  std::int64_t last_utime = 0;
  std::vector<ChannelInfo> channels;   ///< by name; at most `max_channels`
  std::uint64_t events_elsewhere = 0;  ///< on channels beyond those
  Damage damage;
  std::optional<RunFacts> run;
  std::string run_problem;  ///< why there is no `run`
};

/// @throw diagnostics::Failure(bad_usage) when `path` is not a readable file, or has not one
/// message in it without being empty: saying then what it is, as far as that shows.
LogInfo read_info(const std::filesystem::path& path);

/// For people: a few lines and a table.
std::string to_text(const LogInfo& info);

/// The same for programs. Texts from the log are made valid UTF-8 first.
nlohmann::json to_json(const LogInfo& info);

}  // namespace tachless::logger
