#include "logger/info.h"

#include <algorithm>
#include <array>
#include <cinttypes>
#include <cstdio>
#include <limits>
#include <nlohmann/json.hpp>
#include <string_view>

#include "diagnostics/failure.h"
#include "diagnostics/format.h"
#include "logger/message_types.h"
#include "logger/run_info.h"

namespace tachless::logger {
namespace {

using diagnostics::format;

/// b - a for time stamps that may be anything.
std::int64_t difference(std::int64_t b, std::int64_t a) {
  std::int64_t result = 0;
  if (__builtin_sub_overflow(b, a, &result)) {
    result =
        b > a ? std::numeric_limits<std::int64_t>::max() : std::numeric_limits<std::int64_t>::min();
  }
  return result;
}

/// The length in bytes of the UTF-8 character that begins `text`; 0 when it is none.
std::size_t utf8_length(std::string_view text) {
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  const unsigned char lead = byte(0);
  const std::size_t length = lead < 0x80                   ? 1
                             : lead >= 0xc2 && lead < 0xe0 ? 2
                             : lead >= 0xe0 && lead < 0xf0 ? 3
                             : lead >= 0xf0 && lead < 0xf5 ? 4
                                                           : 0;
  if (length == 0 || length > text.size()) return 0;
  for (std::size_t i = 1; i < length; ++i) {
    if (byte(i) < 0x80 || byte(i) >= 0xc0) return 0;
  }
  if (length < 3) return length;
  const unsigned char second = byte(1);
  const bool bad = (lead == 0xe0 && second < 0xa0) || (lead == 0xed && second >= 0xa0) ||
                   (lead == 0xf0 && second < 0x90) || (lead == 0xf4 && second >= 0x90);
  return bad ? 0 : length;
}

RunFacts facts_of(RunLog log) {
  RunFacts facts;
  const auto& scenario = log.scenario();
  facts.run = log.run();
  facts.scenario = printable(scenario.name);
  facts.robot = printable(log.info().robot);
  facts.law = printable(scenario.controller.law);
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

std::string seconds(std::int64_t us) { return format("%.6g s", static_cast<double>(us) * 1e-6); }

std::string ranges(const PieceSummary& piece) {
  std::string text;
  constexpr std::size_t shown = 5;
  for (std::size_t i = 0; i < std::min(shown, piece.missing_list.size()); ++i) {
    const auto& [first, last] = piece.missing_list[i];
    text += (i == 0 ? "" : ", ") + std::to_string(first);
    if (last != first) text += "-" + std::to_string(last);
  }
  return piece.missing_list.size() > shown ? text + ", ..." : text;
}

std::string run_text(const RunFacts& run) {
  std::string text = format("run       %" PRId64 ": %s, %s, %s on %s (%d joints, %s)\n", run.run,
                            run.scenario.c_str(), run.mode.c_str(), run.law.c_str(),
                            run.robot.c_str(), run.num_joints, run.flexible ? "flexible" : "rigid");
  text += format("recorded  by version %s; controller fed with %s\n", run.version.c_str(),
                 run.measurement.c_str());
  const auto& summary = run.summary;
  text += format("ticks     %" PRIu64 " of %" PRId64 " at %.9g s", summary.ticks, run.num_ticks,
                 run.period_s);
  if (summary.ticks != 0) {
    text += format(" (%" PRId64 " to %" PRId64 ")", summary.first_tick, summary.last_tick);
  }
  text += format("\ngaps      %" PRIu64 "\n", summary.gaps());
  for (const auto& piece : summary.pieces) {
    if (piece.absent() && summary.ticks != 0) text += "          " + piece.channel + ": absent\n";
    if (!piece.absent() && piece.missing != 0) {
      text += format("          %s: %" PRIu64 " missing, ticks %s\n", piece.channel.c_str(),
                     piece.missing, ranges(piece).c_str());
    }
    if (piece.duplicates + piece.conflicts != 0) {
      text +=
          format("          %s: %" PRIu64 " repeated, %" PRIu64 " repeated with other contents\n",
                 piece.channel.c_str(), piece.duplicates, piece.conflicts);
    }
  }
  for (const auto& [reason, count] : summary.undecodable) {
    text +=
        format("undecodable  %" PRIu64 " (%s)\n", count, std::string(bus::name(reason)).c_str());
  }
  const auto line = [&](std::uint64_t count, const char* what) {
    if (count != 0) text += format("          %" PRIu64 " %s\n", count, what);
  };
  line(summary.wrong_tick, "with a tick outside of the run or at odds with its time");
  line(summary.too_late, "too far out of order to be used");
  line(summary.foreign_messages, "of other runs");
  for (const auto& fault : summary.faults) {
    text += format("fault     %s at tick %" PRId64 ": %s\n",
                   std::string(loop::name(fault.role)).c_str(), fault.tick, fault.text.c_str());
  }
  return text;
}

}  // namespace

std::string printable(std::string_view text) {
  std::string result;
  while (!text.empty()) {
    const std::size_t length = utf8_length(text);
    const auto first = static_cast<unsigned char>(text[0]);
    if (length == 0 || first < 0x20 || first == 0x7f) {
      result += '?';
    } else {
      result += text.substr(0, length);
    }
    text.remove_prefix(std::max<std::size_t>(length, 1));
  }
  return result;
}

std::optional<double> ChannelInfo::rate_hz() const {
  const double span_s = 1e-6 * static_cast<double>(difference(last_utime, first_utime));
  if (messages < 2 || span_s <= 0) return std::nullopt;
  return static_cast<double>(messages - 1) / span_s;
}

LogInfo read_info(const std::filesystem::path& path) {
  LogInfo info;
  info.path = path;
  LogReader reader(path);
  info.size_bytes = reader.size_bytes();
  std::map<std::string, ChannelInfo, std::less<>> channels;
  bool has_run_info = false;
  while (const auto event = reader.next()) {
    info.first_utime = info.events == 0 ? event->utime : std::min(info.first_utime, event->utime);
    info.last_utime = info.events == 0 ? event->utime : std::max(info.last_utime, event->utime);
    ++info.events;
    auto found = channels.find(event->channel);
    const std::string_view type = type_name(event->data);
    if (event->channel.ends_with(run_info_suffix)) has_run_info = true;
    if (found == channels.end()) {
      if (channels.size() == LogInfo::max_channels) {
        ++info.events_elsewhere;
        continue;
      }
      ChannelInfo fresh;
      fresh.name = event->channel;
      fresh.type = type;
      fresh.first_utime = fresh.last_utime = event->utime;
      found = channels.emplace(fresh.name, fresh).first;
    }
    ChannelInfo& channel = found->second;
    ++channel.messages;
    channel.bytes += event->data.size();
    if (type != channel.type) ++channel.other_type;
    channel.longest_silence_us =
        std::max(channel.longest_silence_us, difference(event->utime, channel.last_utime));
    channel.last_utime = event->utime;
  }
  for (auto& [name, channel] : channels) info.channels.push_back(std::move(channel));
  info.damage = reader.damage();
  if (!has_run_info) {
    info.run_problem = "no RUN_INFO in it: not a log of tachless, or recorded without its start";
    return info;
  }
  try {
    info.run = facts_of(RunLog::open(path));
  } catch (const diagnostics::Failure& failure) {
    info.run_problem = printable(failure.what());
  }
  return info;
}

std::string to_text(const LogInfo& info) {
  std::string text = format("log       %s\n", info.path.c_str());
  text += format("size      %" PRIu64 " bytes, %" PRIu64 " messages, %s\n", info.size_bytes,
                 info.events, seconds(difference(info.last_utime, info.first_utime)).c_str());
  text += info.run ? run_text(*info.run) : "run       unknown: " + info.run_problem + "\n";
  const Damage& damage = info.damage;
  if (!damage.any()) {
    text += "damage    none\n";
  } else {
    text +=
        format("damage    %" PRIu64 " bytes in %" PRIu64 " places hold no message; %" PRIu64
               " message numbers missing, %" PRIu64 " wrong; %" PRIu64 " messages beside damage\n",
               damage.bytes_skipped, damage.stretches, damage.missing_numbers, damage.wrong_numbers,
               damage.suspect_events);
    constexpr std::size_t shown = 10;
    for (std::size_t i = 0; i < std::min(shown, damage.listed.size()); ++i) {
      text += format("          byte %" PRIu64 ": %" PRIu64 " bytes\n", damage.listed[i].offset,
                     damage.listed[i].bytes);
    }
    if (damage.stretches > shown) text += "          ...\n";
  }
  if (damage.numbers_restarted != 0) {
    text += format("          %" PRIu64 " times the message numbers start over: logs appended\n",
                   damage.numbers_restarted);
  }
  std::size_t width = 7;
  for (const auto& channel : info.channels) width = std::max(width, channel.name.size());
  const int column = static_cast<int>(std::min<std::size_t>(width, 63));
  text += format("\n%-*s %10s %10s %10s %14s  %s\n", column, "channel", "messages", "per s",
                 "bytes", "silence", "type");
  for (const auto& channel : info.channels) {
    const auto rate = channel.rate_hz();
    text +=
        format("%-*s %10" PRIu64 " %10s %10" PRIu64 " %14s  %s%s\n", column, channel.name.c_str(),
               channel.messages, rate ? format("%.6g", *rate).c_str() : "-", channel.bytes,
               seconds(channel.longest_silence_us).c_str(),
               channel.type.empty() ? "not ours" : channel.type.c_str(),
               channel.other_type == 0
                   ? ""
                   : format(" (%" PRIu64 " of another type)", channel.other_type).c_str());
  }
  if (info.events_elsewhere != 0) {
    text += format("and %" PRIu64 " messages on further channels\n", info.events_elsewhere);
  }
  return text;
}

nlohmann::json to_json(const LogInfo& info) {
  using nlohmann::json;
  json result;
  result["path"] = printable(info.path.string());
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
  const RunFacts& run = *info.run;
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
  result["run"] = {{"id", run.run},
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
  return result;
}

}  // namespace tachless::logger
