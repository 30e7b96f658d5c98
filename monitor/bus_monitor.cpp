#include "monitor/bus_monitor.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "diagnostics/text.h"

namespace tachless::monitor {
namespace {

using diagnostics::printable;
using Json = nlohmann::ordered_json;

std::string_view short_type(std::string_view type) {
  return type.empty() ? "not ours" : type.substr(type.find('.') + 1);
}

std::string per_s(const std::optional<double>& rate_hz) {
  return rate_hz ? fmt::format("{:.1f}", *rate_hz) : "-";
}

std::string microseconds(const std::optional<double>& s) {
  return s ? fmt::format("{:.1f}", 1e6 * *s) : "-";
}

std::string text_of(const MessageField& field) {
  struct Writer {
    std::string operator()(const std::vector<double>& values) const {
      return fmt::format("[{:.6g}]", fmt::join(values, " "));
    }
    std::string operator()(double value) const { return fmt::format("{:.6g}", value); }
    std::string operator()(std::int64_t value) const { return std::to_string(value); }
    std::string operator()(bool value) const { return value ? "true" : "false"; }
    std::string operator()(const std::string& value) const {
      constexpr std::size_t longest = 40;
      const std::string text = printable(value.substr(0, longest));
      return fmt::format("\"{}{}\"", text, value.size() > longest ? "…" : "");
    }
  };
  return fmt::format("{} {}{}{}", field.name, std::visit(Writer{}, field.value),
                     field.unit.empty() ? "" : " ", field.unit);
}

Json json_of(const MessageField& field) {
  return std::visit(
      [](const auto& value) -> Json {
        if constexpr (std::is_same_v<std::decay_t<decltype(value)>, std::string>) {
          return printable(value);
        } else {
          return value;
        }
      },
      field.value);
}

template <class Value>
Json or_null(const std::optional<Value>& value) {
  return value ? Json(*value) : Json(nullptr);
}

/// At most `columns` characters of UTF-8 text.
std::string clipped(const std::string& text, std::size_t columns) {
  if (columns == 0) return text;
  std::size_t characters = 0;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const bool begins = (static_cast<unsigned char>(text[i]) & 0xc0U) != 0x80U;
    if (begins && ++characters > columns) return text.substr(0, i);
  }
  return text;
}

}  // namespace

void BusMonitor::Arrivals::add(std::int64_t interval_ns) {
  ++intervals;
  const auto interval = static_cast<double>(interval_ns);
  const double before = interval - mean_ns;
  mean_ns += before / static_cast<double>(intervals);
  deviations_ns2 += before * (interval - mean_ns);
  longest_ns = std::max(longest_ns, interval_ns);
}

std::optional<double> BusMonitor::Arrivals::rate_hz() const {
  if (intervals == 0 || mean_ns <= 0) return std::nullopt;
  return 1e9 / mean_ns;
}

std::optional<double> BusMonitor::Arrivals::jitter_s() const {
  if (intervals < 2) return std::nullopt;
  return 1e-9 * std::sqrt(deviations_ns2 / static_cast<double>(intervals - 1));
}

std::uint64_t BusMonitor::Channel::undecodable() const {
  std::uint64_t count = type.empty() ? 0 : not_ours;
  for (const auto& [reason, times] : rejected) count += times;
  return count;
}

void BusMonitor::take(const bus::Datagram& datagram) {
  ++messages_;
  bytes_ += datagram.payload.size();
  note_sender(datagram.sender, datagram.sequence);
  note_channel(datagram);
}

void BusMonitor::note_sender(std::string_view sender, std::uint32_t sequence) {
  auto found = senders_.find(sender);
  if (found == senders_.end()) {
    if (senders_.size() == max_senders) {
      ++other_senders_;
      return;
    }
    found = senders_.emplace(sender, Sender{}).first;
  }
  Sender& known = found->second;
  ++known.messages;
  if (!known.sequence.any()) {
    known.sequence.see(sequence);
  } else {
    // The 32-bit count wraps: the next number is the one nearest to the newest.
    const auto newest = static_cast<std::uint32_t>(known.sequence.newest());
    known.sequence.see(known.sequence.newest() + static_cast<std::int32_t>(sequence - newest));
  }
}

void BusMonitor::note_channel(const bus::Datagram& datagram) {
  const auto& [name, payload, sender, sequence, received_ns] = datagram;
  auto found = channels_.find(name);
  if (found == channels_.end()) {
    if (channels_.size() == max_channels) {
      ++elsewhere_;
      return;
    }
    found = channels_.emplace(name, Channel{}).first;
  }
  Channel& channel = found->second;
  ++channel.messages;
  channel.bytes += payload.size();
  ++channel.now.messages;
  channel.now.bytes += payload.size();
  // A clock that was set back gives an interval that says nothing.
  if (channel.last_ns && received_ns >= *channel.last_ns) {
    channel.now.add(received_ns - *channel.last_ns);
  }
  channel.last_ns = received_ns;

  const MessageReader::Glance glance = reader_.glance(payload);
  if (glance.type.empty()) {
    ++channel.not_ours;
    return;
  }
  channel.type = glance.type;
  if (glance.rejection != bus::Rejection::none) {
    ++channel.rejected[glance.rejection];
    return;
  }
  if (glance.tagged) ++channel.tagged;
  channel.newest_stamp = glance.stamp;
  channel.newest.assign(payload.begin(), payload.end());
  channel.once_per_tick = glance.once_per_tick;
  if (!glance.once_per_tick) return;
  if (glance.stamp.run != channel.run) channel.ticks.start_over();
  channel.run = glance.stamp.run;
  channel.ticks.see(glance.stamp.tick);
}

void BusMonitor::end_stretch(double seconds) {
  seconds_ += seconds;
  for (auto& [name, channel] : channels_) {
    channel.shown = channel.now;
    channel.shown_seconds = seconds;
    channel.now = {};
  }
}

std::uint64_t BusMonitor::undecodable() const {
  std::uint64_t count = 0;
  for (const auto& [name, channel] : channels_) count += channel.undecodable();
  return count;
}

std::vector<std::string> BusMonitor::head_lines() const {
  std::uint64_t missing = 0;
  for (const auto& [address, sender] : senders_) missing += sender.sequence.missing();
  std::vector<std::string> lines = {fmt::format(
      "{} messages of {} senders in {:.1f} s; by the senders' own count {} missing; undecodable {}",
      messages_, senders_.size(), seconds_, missing, undecodable())};
  const auto note = [&](std::uint64_t count, std::string_view what) {
    if (count != 0) lines.push_back(fmt::format("{} {}", count, what));
  };
  note(transport_.overflowed.value_or(0),
       "lost here: this program was too slow for the bus, and rates are higher than shown");
  note(transport_.malformed, "datagrams that are not LCM messages");
  note(transport_.fragmented, "messages in fragments, which are not put together here");
  std::uint64_t tagged = 0;
  for (const auto& [name, channel] : channels_) tagged += channel.tagged;
  note(tagged, "messages carry the tag of a key, which is not verified here");
  note(elsewhere_, "messages on further channels");
  note(other_senders_, "messages of further senders");
  return lines;
}

std::vector<std::string> BusMonitor::channel_lines(std::size_t columns) const {
  std::size_t width = 7;
  for (const auto& [name, channel] : channels_) width = std::max(width, printable(name).size());
  // The numbers come first; the types where there is room for them.
  constexpr const char* row = "{:<{}} {:>9} {:>9} {:>10} {:>8} {:>6} {:>11}  {:.{}}";
  constexpr std::size_t width_of_numbers = 61, longest_type = 28;
  const bool has_room = columns == 0 || width + width_of_numbers + longest_type <= columns;
  const std::size_t type_width = has_room ? longest_type : 0;
  std::vector<std::string> lines = {fmt::format(row, "channel", width, "messages", "per s",
                                                "jitter us", "kB/s", "gaps", "undecodable", "type",
                                                type_width)};
  for (const auto& [name, channel] : channels_) {
    const double bytes = static_cast<double>(channel.shown.bytes);
    const double kb_per_s = channel.shown_seconds > 0 ? 1e-3 * bytes / channel.shown_seconds : 0.0;
    lines.push_back(
        fmt::format(row, printable(name), width, channel.messages, per_s(channel.shown.rate_hz()),
                    microseconds(channel.shown.jitter_s()), fmt::format("{:.1f}", kb_per_s),
                    channel.once_per_tick ? std::to_string(channel.ticks.missing()) : "-",
                    channel.undecodable(), short_type(channel.type), type_width));
  }
  return lines;
}

std::vector<std::string> BusMonitor::value_lines() {
  std::size_t width = 0;
  for (const auto& [name, channel] : channels_) width = std::max(width, printable(name).size());
  std::vector<std::string> lines;
  for (const auto& [name, channel] : channels_) {
    if (channel.newest.empty()) continue;
    std::vector<std::string> parts = {
        fmt::format("{:<{}}  tick {}", printable(name), width, channel.newest_stamp.tick)};
    for (const MessageField& field : reader_.fields(channel.newest))
      parts.push_back(text_of(field));
    lines.push_back(diagnostics::joined(parts, "  "));
  }
  return lines;
}

std::vector<std::string> BusMonitor::table(std::size_t columns, std::size_t rows) {
  std::vector<std::string> lines = head_lines();
  const auto append = [&](std::vector<std::string> more) {
    lines.emplace_back();
    std::move(more.begin(), more.end(), std::back_inserter(lines));
  };
  append(channel_lines(columns));
  append(value_lines());
  if (rows != 0 && lines.size() > rows) {
    const std::size_t left_out = lines.size() - (rows - 1);
    lines.resize(rows - 1);
    lines.push_back(fmt::format("… {} lines more than this window has", left_out));
  }
  for (std::string& line : lines) line = clipped(line, columns);
  return lines;
}

nlohmann::ordered_json BusMonitor::to_json() {
  Json result;
  result["seconds"] = seconds_;
  result["messages"] = messages_;
  result["bytes"] = bytes_;
  result["undecodable"] = undecodable();
  result["malformed"] = transport_.malformed;
  result["fragmented"] = transport_.fragmented;
  result["lost_here"] = transport_.overflowed.value_or(0);
  result["messages_on_further_channels"] = elsewhere_;
  result["messages_of_further_senders"] = other_senders_;
  result["senders"] = Json::array();
  for (const auto& [address, sender] : senders_) {
    result["senders"].push_back({{"address", address},
                                 {"messages", sender.messages},
                                 {"missing", sender.sequence.missing()},
                                 {"repeated", sender.sequence.repeated()},
                                 {"restarts", sender.sequence.restarts()}});
  }
  result["channels"] = Json::array();
  for (const auto& [name, channel] : channels_) {
    Json entry;
    entry["channel"] = printable(name);
    entry["type"] = channel.type.empty() ? Json(nullptr) : Json(channel.type);
    entry["messages"] = channel.messages;
    entry["bytes"] = channel.bytes;
    entry["rate_hz"] = or_null(channel.shown.rate_hz());
    const auto jitter_s = channel.shown.jitter_s();
    entry["jitter_us"] = jitter_s ? Json(1e6 * *jitter_s) : Json(nullptr);
    entry["longest_silence_us"] = 1e-3 * static_cast<double>(channel.shown.longest_ns);
    entry["bandwidth_bytes_per_s"] =
        channel.shown_seconds > 0
            ? Json(static_cast<double>(channel.shown.bytes) / channel.shown_seconds)
            : Json(nullptr);
    entry["tick_gaps"] = channel.once_per_tick ? Json(channel.ticks.missing()) : Json(nullptr);
    entry["tick_repeats"] = channel.once_per_tick ? Json(channel.ticks.repeated()) : Json(nullptr);
    entry["undecodable"] = channel.undecodable();
    entry["undecodable_because"] = Json::object();
    for (const auto& [reason, count] : channel.rejected) {
      entry["undecodable_because"][std::string(bus::name(reason))] = count;
    }
    entry["tagged"] = channel.tagged;
    entry["not_ours"] = channel.not_ours;
    entry["newest"] = nullptr;
    if (!channel.newest.empty()) {
      Json newest = {{"utime", channel.newest_stamp.utime},
                     {"run", channel.newest_stamp.run},
                     {"tick", channel.newest_stamp.tick}};
      for (const MessageField& field : reader_.fields(channel.newest)) {
        newest[std::string(field.name)] = json_of(field);
      }
      entry["newest"] = std::move(newest);
    }
    result["channels"].push_back(std::move(entry));
  }
  return result;
}

}  // namespace tachless::monitor
