#include "logger/info.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string_view>
#include <vector>

#include "base/failure.h"
#include "base/json_text.h"
#include "base/text.h"
#include "logger/log_file.h"
#include "logger/run_log.h"
#include "messages/truth/truth_wire.h"

/// A value of the description in a line: text without quotes.
template <>
struct fmt::formatter<nlohmann::json> : fmt::formatter<std::string> {
  template <class Context>
  auto format(const nlohmann::json& value, Context& context) const {
    return fmt::formatter<std::string>::format(
        value.is_string() ? value.get<std::string>() : tachless::base::json_text(value), context);
  }
};

namespace tachless::logger {

NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(DamagedStretch, offset, bytes)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Damage, bytes_skipped, stretches, missing_numbers,
                                   numbers_restarted, listed)

namespace {

using base::printable;
using nlohmann::json;

/// b - a for time stamps that may be anything.
std::int64_t difference(std::int64_t b, std::int64_t a) {
  std::int64_t result = 0;
  if (__builtin_sub_overflow(b, a, &result)) {
    result =
        b > a ? std::numeric_limits<std::int64_t>::max() : std::numeric_limits<std::int64_t>::min();
  }
  return result;
}

/// The name of a message's type by its LCM fingerprint, "tachless.tick_t"; empty when the type is
/// not one of ours. Looks at nothing else: the message may be undecodable all the same.
std::string_view type_name(std::optional<std::int64_t> fingerprint) {
  std::string_view name;
  for_each_type(messages::AllMessages(), [&]<class Value>(std::type_identity<Value>) {
    if (fingerprint == messages::fingerprint<Value>()) name = Value::type;
  });
  return name;
}

/// Counts messages by channel.
class ChannelTally {
 public:
  void add(const LogEvent& event) {
    first_utime_ = events_ == 0 ? event.utime : std::min(first_utime_, event.utime);
    last_utime_ = events_ == 0 ? event.utime : std::max(last_utime_, event.utime);
    ++events_;
    Channel* const channel = find(event);
    if (channel == nullptr) {
      ++elsewhere_;
      return;
    }
    ++channel->messages;
    channel->bytes += event.data.size();
    const auto fingerprint = messages::fingerprint_of(event.data);
    if (fingerprint != channel->fingerprint && type_name(fingerprint) != channel->type) {
      ++channel->other_type;
    }
    channel->longest_silence_us =
        std::max(channel->longest_silence_us, difference(event.utime, channel->last_utime));
    if (event.utime < channel->last_utime) channel->went_back = true;
    channel->last_utime = event.utime;
  }

  void write_to(json& info) const {
    info["messages"] = events_;
    info["messages_on_further_channels"] = elsewhere_;
    info["first_utime"] = first_utime_;
    info["last_utime"] = last_utime_;
    json& channels = info["channels"] = json::array();
    for (const auto& [name, channel] : channels_) {
      const double span_s =
          1e-6 * static_cast<double>(difference(channel.last_utime, channel.first_utime));
      const bool has_rate = channel.messages >= 2 && span_s > 0 && !channel.went_back;
      channels.push_back(
          {{"channel", printable(name)},
           {"messages", channel.messages},
           {"bytes", channel.bytes},
           {"type", channel.type.empty() ? json(nullptr) : json(channel.type)},
           {"other_type", channel.other_type},
           {"rate_hz",
            has_rate ? json(static_cast<double>(channel.messages - 1) / span_s) : json(nullptr)},
           {"first_utime", channel.first_utime},
           {"last_utime", channel.last_utime},
           {"longest_silence_us", channel.longest_silence_us}});
    }
  }

 private:
  struct Channel {
    std::string_view type;                    ///< of the first message; empty when not ours
    std::optional<std::int64_t> fingerprint;  ///< of the first message
    std::int64_t first_utime = 0;
    std::int64_t last_utime = 0;
    std::uint64_t messages = 0;
    std::uint64_t bytes = 0;              ///< of data
    std::uint64_t other_type = 0;         ///< messages of another type than the first one
    std::int64_t longest_silence_us = 0;  ///< between two messages that follow each other
    bool went_back = false;               ///< a time stamp is before the one before it
  };
  using Channels = std::map<std::string, Channel, std::less<>>;

  /// @return null when there are too many channels already
  Channel* find(const LogEvent& event) {
    auto found = channels_.find(event.channel);
    if (found == channels_.end()) {
      if (channels_.size() == max_channels) return nullptr;
      const auto fingerprint = messages::fingerprint_of(event.data);
      found = channels_
                  .emplace(event.channel,
                           Channel{type_name(fingerprint), fingerprint, event.utime, event.utime})
                  .first;
    }
    return &found->second;
  }

  std::uint64_t events_ = 0;
  std::uint64_t elsewhere_ = 0;   ///< on channels beyond `max_channels`
  std::int64_t first_utime_ = 0;  ///< smallest and largest
  std::int64_t last_utime_ = 0;
  Channels channels_;
};

json damage_json(const Damage& damage) {
  json result = damage;
  result["any"] = damage.any();
  return result;
}

/// How the run ended; `how` is "planned", "stopped" or "unknown".
json end_json(const RunSummary& summary, std::int64_t num_ticks) {
  const std::string reason = summary.stop_reason(num_ticks);
  if (reason.empty()) return {{"how", "planned"}, {"text", nullptr}};
  return {{"how", summary.stop ? "stopped" : "unknown"}, {"text", printable(reason)}};
}

/// Reads the log from its start to its end.
json run_json(RunLog& log) {
  for (TickRecord record; log.next(record);) {
  }
  const RunSummary& summary = log.summary();
  json pieces = json::array();
  for (const auto& piece : summary.pieces) {
    if (piece.channel.empty()) continue;
    json missing = json::array();
    for (const auto& range : piece.missing.listed) missing.push_back({range.first, range.last});
    pieces.push_back({{"channel", piece.channel},
                      {"ticks", piece.count},
                      {"absent", piece.absent()},
                      {"duplicates", piece.duplicates},
                      {"conflicts", piece.conflicts},
                      {"missing", piece.missing.count},
                      {"missing_ticks", missing}});
  }
  json undecodable = json::object();
  for (const auto& [reason, count] : summary.undecodable) {
    undecodable[std::string(messages::name(reason))] = count;
  }
  json faults = json::array();
  for (const auto& fault : summary.faults) {
    faults.push_back({{"role", messages::name(fault.role)},
                      {"tick", fault.tick},
                      {"text", printable(fault.text)}});
  }
  json gains = json::array();
  for (const auto& [tick, changed] : summary.gains) {
    gains.push_back({{"tick", tick}, {"gains", printable(changed)}});
  }
  json foreign = json::object();
  for (const auto& [id, count] : summary.foreign_runs) foreign[std::to_string(id)] = count;
  const scenario::Scenario& scenario = log.scenario();
  const bool lockstep = scenario.loop.mode == scenario::Mode::lockstep;
  return {{"id", log.run()},
          {"scenario", printable(scenario.name)},
          {"robot", printable(log.info().robot)},
          {"law", printable(scenario.controller.law_text())},
          {"measurement", printable(log.info().measurement)},
          {"mode", lockstep ? "lockstep" : "realtime"},
          {"version", printable(log.info().version)},
          {"period_s", log.info().period_s},
          {"num_ticks", log.info().num_ticks},
          {"num_joints", scenario.num_joints},
          {"flexible", scenario.robot.flexible.has_value()},
          {"compensates", scenario.robot.compensates.text()},
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
          {"gains", gains},
          {"faults", faults},
          {"end", end_json(summary, log.info().num_ticks)}};
}

std::string seconds(std::int64_t us) {
  return fmt::format("{:.6g} s", static_cast<double>(us) * 1e-6);
}

std::string ranges(const json& missing_ticks) {
  constexpr std::size_t shown = 5;
  std::vector<std::string> parts;
  for (const json& range : missing_ticks) {
    if (parts.size() == shown) {
      parts.emplace_back("...");
      break;
    }
    parts.push_back(range[0] == range[1] ? base::json_text(range[0])
                                         : fmt::format("{}-{}", range[0], range[1]));
  }
  return base::joined(parts);
}

std::string run_text(const json& run) {
  const std::string added = run["compensates"] == "nothing"
                                ? ""
                                : fmt::format("; the arm itself adds {}", run["compensates"]);
  std::string text = fmt::format(
      "run       {}: {}, {}, {} on {} ({} joints, {}{})\n"
      "recorded  by version {}; controller fed with {}\n"
      "ticks     {} of {} at {:.9g} s",
      run["id"], run["scenario"], run["mode"], run["law"], run["robot"], run["num_joints"],
      run["flexible"] ? "flexible" : "rigid", added, run["version"], run["measurement"],
      run["ticks"], run["num_ticks"], run["period_s"].get<double>());
  const bool has_ticks = run["ticks"] != 0;
  if (has_ticks) text += fmt::format(" ({} to {})", run["first_tick"], run["last_tick"]);
  const json& end = run["end"];
  text += end["how"] == "planned"
              ? "\nended     as planned"
              : fmt::format("\nended     {}", end["text"].get_ref<const std::string&>());
  text += fmt::format("\ngaps      {}\n", run["gaps"]);
  for (const json& piece : run["pieces"]) {
    const auto line = [&](std::string_view what) {
      text += fmt::format("          {}: {}\n", piece["channel"], what);
    };
    if (piece["absent"] && has_ticks) line("absent");
    if (!piece["absent"] && piece["missing"] != 0) {
      line(fmt::format("{} missing, ticks {}", piece["missing"], ranges(piece["missing_ticks"])));
    }
    if (piece["duplicates"] != 0 || piece["conflicts"] != 0) {
      line(fmt::format("{} repeated, {} repeated with other contents", piece["duplicates"],
                       piece["conflicts"]));
    }
  }
  for (int reason = 0; reason <= static_cast<int>(messages::Rejection::bad_value); ++reason) {
    const std::string name(messages::name(static_cast<messages::Rejection>(reason)));
    const json& count = run["undecodable"].value(name, json(0));
    if (count != 0) text += fmt::format("undecodable  {} ({})\n", count, name);
  }
  const auto line = [&](const json& count, std::string_view what) {
    if (count != 0) text += fmt::format("          {} {}\n", count, what);
  };
  line(run["wrong_tick"], "with a tick outside of the run or at odds with its time");
  line(run["too_late"], "too far out of order to be used");
  std::vector<std::string> ids;
  for (const auto& [id, count] : run["foreign_runs"].items()) ids.push_back(id);
  line(run["foreign_messages"], "of other runs: " + base::joined(ids));
  for (const json& change : run["gains"]) {
    text += fmt::format("gains     from tick {}: {}\n", change["tick"], change["gains"]);
  }
  for (const json& fault : run["faults"]) {
    text +=
        fmt::format("fault     {} at tick {}: {}\n", fault["role"], fault["tick"], fault["text"]);
  }
  return text;
}

std::string damage_text(const Damage& damage) {
  std::string text = fmt::format("damage    {}\n", damage.text());
  constexpr std::size_t shown = 10;
  for (std::size_t i = 0; i < std::min(shown, damage.listed.size()); ++i) {
    const DamagedStretch& stretch = damage.listed[i];
    text += fmt::format("          byte {}: {} bytes\n", stretch.offset, stretch.bytes);
  }
  if (damage.stretches > shown) text += "          ...\n";
  if (damage.numbers_restarted != 0) {
    text += fmt::format("          {} times the message numbers start over: logs appended\n",
                        damage.numbers_restarted);
  }
  return text;
}

std::string channels_text(const json& info) {
  std::vector<std::vector<std::string>> rows = {
      {"channel", "messages", "per s", "bytes", "silence", "type"}};
  for (const json& channel : info["channels"]) {
    const json& rate = channel["rate_hz"];
    const std::string type = channel["type"].is_null() ? "not ours" : channel["type"];
    const json& others = channel["other_type"];
    rows.push_back({channel["channel"], base::json_text(channel["messages"]),
                    rate.is_null() ? "-" : fmt::format("{:.6g}", rate.get<double>()),
                    base::json_text(channel["bytes"]), seconds(channel["longest_silence_us"]),
                    type + (others == 0 ? "" : fmt::format(" ({} of another type)", others))});
  }
  std::string text = "\n" + base::table(rows, "lrrrrl");
  const json& elsewhere = info["messages_on_further_channels"];
  if (elsewhere != 0) text += fmt::format("and {} messages on further channels\n", elsewhere);
  return text;
}

}  // namespace

json read_info(const std::filesystem::path& path) {
  json info = {{"path", path.string()}, {"run", nullptr}};
  ChannelTally tally;
  try {
    RunLog log = RunLog::open(path);
    log.watch([&](const LogEvent& event) { tally.add(event); });
    info["run"] = run_json(log);
    info["damage"] = damage_json(log.damage());
  } catch (const base::Failure& failure) {
    info["run_problem"] = printable(failure.what());
    LogReader reader(path);
    while (const auto event = reader.next()) tally.add(*event);
    info["damage"] = damage_json(reader.damage());
  }
  info["size_bytes"] = std::filesystem::file_size(path);
  tally.write_to(info);
  if (info["messages"] == 0) {
    throw base::bad_usage("{}: {}", path.string(), no_log_text(path));
  }
  const bool has_run_info = std::ranges::any_of(info["channels"], [](const json& each) {
    return each["channel"].get_ref<const std::string&>().ends_with(run_info_suffix);
  });
  if (info["run"].is_null() && !has_run_info) {
    info["run_problem"] = "no RUN_INFO in it: not a log of tachless, or recorded without its start";
  }
  return info;
}

std::string to_text(const json& info) {
  return fmt::format("log       {}\nsize      {} bytes, {} messages, {}\n",
                     printable(info["path"].get_ref<const std::string&>()), info["size_bytes"],
                     info["messages"],
                     seconds(difference(info["last_utime"], info["first_utime"]))) +
         (info["run"].is_null() ? fmt::format("run       unknown: {}\n", info["run_problem"])
                                : run_text(info["run"])) +
         damage_text(info["damage"].get<Damage>()) + channels_text(info);
}

}  // namespace tachless::logger
