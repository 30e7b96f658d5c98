#include "logger/info.h"

#include <fmt/format.h>

#include <algorithm>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <string_view>

#include "diagnostics/failure.h"
#include "diagnostics/text.h"
#include "logger/message_types.h"
#include "logger/run_info.h"

namespace tachless::logger {
namespace {

using diagnostics::printable;

/// b - a for time stamps that may be anything.
std::int64_t difference(std::int64_t b, std::int64_t a) {
  std::int64_t result = 0;
  if (__builtin_sub_overflow(b, a, &result)) {
    result =
        b > a ? std::numeric_limits<std::int64_t>::max() : std::numeric_limits<std::int64_t>::min();
  }
  return result;
}

RunFacts facts_of(RunLog& log) {
  RunFacts facts;
  const auto& scenario = log.scenario();
  facts.run = log.run();
  facts.scenario = printable(scenario.name);
  facts.robot = printable(log.info().robot);
  facts.law = printable(scenario.controller.law_text());
  facts.measurement = printable(log.info().measurement);
  facts.mode = scenario.loop.mode == experiment::Mode::lockstep ? "lockstep" : "realtime";
  facts.version = printable(log.info().version);
  facts.period_s = log.info().period_s;
  facts.num_ticks = log.info().num_ticks;
  facts.num_joints = scenario.num_joints;
  facts.flexible = scenario.robot.flexible.has_value();
  TickRecord record;
  while (log.next(record)) {
  }
  facts.summary = log.summary();
  for (auto& fault : facts.summary.faults) fault.text = printable(fault.text);
  return facts;
}

std::string seconds(std::int64_t us) {
  return fmt::format("{:.6g} s", static_cast<double>(us) * 1e-6);
}

std::string ranges(const PieceSummary& piece) {
  constexpr std::size_t shown = 5;
  std::vector<std::string> parts;
  for (const auto& [first, last] : piece.missing_list) {
    if (parts.size() == shown) {
      parts.emplace_back("...");
      break;
    }
    parts.push_back(first == last ? std::to_string(first) : fmt::format("{}-{}", first, last));
  }
  return diagnostics::joined(parts);
}

std::string run_text(const RunFacts& run) {
  const auto& summary = run.summary;
  std::string text = fmt::format(
      "run       {}: {}, {}, {} on {} ({} joints, {})\n"
      "recorded  by version {}; controller fed with {}\n"
      "ticks     {} of {} at {:.9g} s",
      run.run, run.scenario, run.mode, run.law, run.robot, run.num_joints,
      run.flexible ? "flexible" : "rigid", run.version, run.measurement, summary.ticks,
      run.num_ticks, run.period_s);
  if (summary.ticks != 0) text += fmt::format(" ({} to {})", summary.first_tick, summary.last_tick);
  text += fmt::format("\ngaps      {}\n", summary.gaps());
  for (const auto& piece : summary.pieces) {
    if (piece.absent() && summary.ticks != 0) {
      text += fmt::format("          {}: absent\n", piece.channel);
    }
    if (!piece.absent() && piece.missing != 0) {
      text += fmt::format("          {}: {} missing, ticks {}\n", piece.channel, piece.missing,
                          ranges(piece));
    }
    if (piece.duplicates + piece.conflicts != 0) {
      text += fmt::format("          {}: {} repeated, {} repeated with other contents\n",
                          piece.channel, piece.duplicates, piece.conflicts);
    }
  }
  for (const auto& [reason, count] : summary.undecodable) {
    text += fmt::format("undecodable  {} ({})\n", count, bus::name(reason));
  }
  const auto line = [&](std::uint64_t count, std::string_view what) {
    if (count != 0) text += fmt::format("          {} {}\n", count, what);
  };
  line(summary.wrong_tick, "with a tick outside of the run or at odds with its time");
  line(summary.too_late, "too far out of order to be used");
  line(summary.foreign_messages, "of other runs");
  for (const auto& fault : summary.faults) {
    text += fmt::format("fault     {} at tick {}: {}\n", loop::name(fault.role), fault.tick,
                        fault.text);
  }
  return text;
}

std::string damage_text(const Damage& damage) {
  std::string text = "damage    none\n";
  if (damage.any()) {
    text = fmt::format(
        "damage    {} bytes in {} places hold no message; {} message numbers missing, {} wrong; {} "
        "messages beside damage\n",
        damage.bytes_skipped, damage.stretches, damage.missing_numbers, damage.wrong_numbers,
        damage.suspect_events);
    constexpr std::size_t shown = 10;
    for (std::size_t i = 0; i < std::min(shown, damage.listed.size()); ++i) {
      text += fmt::format("          byte {}: {} bytes\n", damage.listed[i].offset,
                          damage.listed[i].bytes);
    }
    if (damage.stretches > shown) text += "          ...\n";
  }
  if (damage.numbers_restarted != 0) {
    text += fmt::format("          {} times the message numbers start over: logs appended\n",
                        damage.numbers_restarted);
  }
  return text;
}

std::string channels_text(const LogInfo& info) {
  std::size_t width = 7;
  for (const auto& channel : info.channels) width = std::max(width, channel.name.size());
  width = std::min<std::size_t>(width, 63);
  std::string text = fmt::format("\n{:<{}} {:>10} {:>10} {:>10} {:>14}  {}\n", "channel", width,
                                 "messages", "per s", "bytes", "silence", "type");
  for (const auto& channel : info.channels) {
    const auto rate = channel.rate_hz();
    text += fmt::format("{:<{}} {:>10} {:>10} {:>10} {:>14}  {}", channel.name, width,
                        channel.messages, rate ? fmt::format("{:.6g}", *rate) : "-", channel.bytes,
                        seconds(channel.longest_silence_us),
                        channel.type.empty() ? "not ours" : channel.type);
    if (channel.other_type != 0) text += fmt::format(" ({} of another type)", channel.other_type);
    text += '\n';
  }
  if (info.events_elsewhere != 0) {
    text += fmt::format("and {} messages on further channels\n", info.events_elsewhere);
  }
  return text;
}

}  // namespace

std::optional<double> ChannelInfo::rate_hz() const {
  const double span_s = 1e-6 * static_cast<double>(difference(last_utime, first_utime));
  if (messages < 2 || span_s <= 0) return std::nullopt;
  return static_cast<double>(messages - 1) / span_s;
}

namespace {

/// Counts messages by channel.
class ChannelTally {
 public:
  explicit ChannelTally(LogInfo& info) : info_(info) {}

  void add(const LogEvent& event) {
    info_.first_utime = info_.events == 0 ? event.utime : std::min(info_.first_utime, event.utime);
    info_.last_utime = info_.events == 0 ? event.utime : std::max(info_.last_utime, event.utime);
    ++info_.events;
    Entry* const entry = find(event);
    if (entry == nullptr) {
      ++info_.events_elsewhere;
      return;
    }
    ChannelInfo& channel = entry->channel;
    ++channel.messages;
    channel.bytes += event.data.size();
    if (bus::fingerprint_of(event.data) != entry->fingerprint &&
        type_name(event.data) != channel.type) {
      ++channel.other_type;
    }
    channel.longest_silence_us =
        std::max(channel.longest_silence_us, difference(event.utime, channel.last_utime));
    channel.last_utime = event.utime;
  }

  /// Hands over the channels.
  void finish() {
    for (auto& [name, entry] : entries_) info_.channels.push_back(std::move(entry.channel));
  }

 private:
  struct Entry {
    ChannelInfo channel;
    std::optional<std::int64_t> fingerprint;  ///< of the first message
    Entry* follower = nullptr;                ///< of which the message after the last one was
  };

  /// @return null when there are too many channels already
  Entry* find(const LogEvent& event) {
    if (last_ != nullptr && last_->follower != nullptr &&
        last_->follower->channel.name == event.channel) {
      return last_ = last_->follower;
    }
    auto found = entries_.find(event.channel);
    if (found == entries_.end()) {
      if (entries_.size() == LogInfo::max_channels) return nullptr;
      Entry fresh;
      fresh.channel.name = event.channel;
      fresh.channel.type = type_name(event.data);
      fresh.channel.first_utime = fresh.channel.last_utime = event.utime;
      fresh.fingerprint = bus::fingerprint_of(event.data);
      found = entries_.emplace(event.channel, std::move(fresh)).first;
    }
    if (last_ != nullptr) last_->follower = &found->second;
    return last_ = &found->second;
  }

  LogInfo& info_;
  std::map<std::string, Entry, std::less<>> entries_;
  Entry* last_ = nullptr;
};

/// What a file without any message is, by its beginning.
std::string no_log_text(const std::filesystem::path& path) {
  std::string text(1 << 16, '\0');
  std::ifstream file(path, std::ios::binary);
  file.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<std::size_t>(file.gcount()));
  const std::string name = path.string();
  if (text.find("<robot") != std::string::npos) {
    return fmt::format("{}: this is a robot description: tachless robot {}", name, name);
  }
  if (text.find("\nrobot:") != std::string::npos &&
      text.find("\ncontroller:") != std::string::npos) {
    return fmt::format("{}: this is a scenario: tachless run {}", name, name);
  }
  return fmt::format("{}: not one message of an LCM log is in it; name an LCM log", name);
}

}  // namespace

LogInfo read_info(const std::filesystem::path& path) {
  LogInfo info;
  info.path = path;
  ChannelTally tally(info);
  try {
    RunLog log = RunLog::open(path);
    log.watch([&](const LogEvent& event) { tally.add(event); });
    info.run = facts_of(log);
    info.damage = log.damage();
  } catch (const diagnostics::Failure& failure) {
    info.run_problem = printable(failure.what());
    LogReader reader(path);
    while (const auto event = reader.next()) tally.add(*event);
    info.damage = reader.damage();
  }
  info.size_bytes = std::filesystem::file_size(path);
  tally.finish();
  if (info.events == 0 && info.size_bytes > 0) {
    throw diagnostics::bad_usage(no_log_text(path));
  }
  const bool has_run_info = std::ranges::any_of(
      info.channels, [](const ChannelInfo& each) { return each.name.ends_with(run_info_suffix); });
  if (!info.run && !has_run_info) {
    info.run_problem = "no RUN_INFO in it: not a log of tachless, or recorded without its start";
  }
  return info;
}

std::string to_text(const LogInfo& info) {
  return fmt::format("log       {}\nsize      {} bytes, {} messages, {}\n",
                     printable(info.path.native()), info.size_bytes, info.events,
                     seconds(difference(info.last_utime, info.first_utime))) +
         (info.run ? run_text(*info.run)
                   : fmt::format("run       unknown: {}\n", info.run_problem)) +
         damage_text(info.damage) + channels_text(info);
}

namespace {

nlohmann::json json_of(const RunFacts& run) {
  using nlohmann::json;
  const RunSummary& summary = run.summary;
  json pieces = json::array();
  for (const auto& piece : summary.pieces) {
    json missing = json::array();
    for (const auto& range : piece.missing_list) missing.push_back({range.first, range.last});
    pieces.push_back({{"channel", piece.channel},
                      {"ticks", piece.count},
                      {"absent", piece.absent()},
                      {"duplicates", piece.duplicates},
                      {"conflicts", piece.conflicts},
                      {"missing", piece.missing},
                      {"missing_ticks", missing}});
  }
  json undecodable = json::object();
  for (const auto& [reason, count] : summary.undecodable) {
    undecodable[std::string(bus::name(reason))] = count;
  }
  json faults = json::array();
  for (const auto& fault : summary.faults) {
    faults.push_back(
        {{"role", loop::name(fault.role)}, {"tick", fault.tick}, {"text", fault.text}});
  }
  json foreign = json::object();
  for (const auto& [id, count] : summary.foreign_runs) foreign[std::to_string(id)] = count;
  return {{"id", run.run},
          {"scenario", run.scenario},
          {"robot", run.robot},
          {"law", run.law},
          {"measurement", run.measurement},
          {"mode", run.mode},
          {"version", run.version},
          {"period_s", run.period_s},
          {"num_ticks", run.num_ticks},
          {"num_joints", run.num_joints},
          {"flexible", run.flexible},
          {"ticks", summary.ticks},
          {"first_tick", summary.first_tick},
          {"last_tick", summary.last_tick},
          {"gaps", summary.gaps()},
          {"pieces", pieces},
          {"undecodable", undecodable},
          {"wrong_tick", summary.wrong_tick},
          {"too_late", summary.too_late},
          {"foreign_messages", summary.foreign_messages},
          {"foreign_runs", foreign},
          {"faults", faults}};
}

}  // namespace

nlohmann::json to_json(const LogInfo& info) {
  using nlohmann::json;
  json result;
  result["path"] = info.path.string();
  result["size_bytes"] = info.size_bytes;
  result["messages"] = info.events;
  result["messages_on_further_channels"] = info.events_elsewhere;
  result["first_utime"] = info.first_utime;
  result["last_utime"] = info.last_utime;
  json stretches = json::array();
  for (const auto& stretch : info.damage.listed) {
    stretches.push_back({{"offset", stretch.offset}, {"bytes", stretch.bytes}});
  }
  result["damage"] = {{"any", info.damage.any()},
                      {"bytes_skipped", info.damage.bytes_skipped},
                      {"stretches", info.damage.stretches},
                      {"missing_numbers", info.damage.missing_numbers},
                      {"wrong_numbers", info.damage.wrong_numbers},
                      {"numbers_restarted", info.damage.numbers_restarted},
                      {"suspect_messages", info.damage.suspect_events},
                      {"listed", stretches}};
  json channels = json::array();
  for (const auto& channel : info.channels) {
    const auto rate = channel.rate_hz();
    channels.push_back({{"channel", channel.name},
                        {"messages", channel.messages},
                        {"bytes", channel.bytes},
                        {"type", channel.type.empty() ? json(nullptr) : json(channel.type)},
                        {"other_type", channel.other_type},
                        {"rate_hz", rate ? json(*rate) : json(nullptr)},
                        {"first_utime", channel.first_utime},
                        {"last_utime", channel.last_utime},
                        {"longest_silence_us", channel.longest_silence_us}});
  }
  result["channels"] = channels;
  if (!info.run) {
    result["run"] = nullptr;
    result["run_problem"] = info.run_problem;
    return result;
  }
  result["run"] = json_of(*info.run);
  return result;
}

}  // namespace tachless::logger
