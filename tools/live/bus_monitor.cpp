#include "live/bus_monitor.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <optional>
#include <type_traits>
#include <utility>

#include "base/json_text.h"
#include "base/text.h"
#include "bus/authenticated.h"

namespace tachless::live {
namespace {

using base::printable;
using Json = nlohmann::ordered_json;

Json list(const Vector& x) { return std::vector(x.begin(), x.end()); }

/// Appends one field, for a reader of the bus.
template <class Value, class Member>
void describe(const messages::Field<Value, Member>& field, const Value& value,
              std::vector<MessageField>& fields) {
  const Member& member = value.*field.member;
  const auto add = [&](Json shown, std::string_view index = {}) {
    fields.push_back({fmt::format("{}{}", field.name, index), field.unit, std::move(shown)});
  };
  if constexpr (std::is_same_v<Member, Vector>) {
    add(list(member));
  } else if constexpr (std::is_same_v<Member, std::array<bool, max_joints>>) {
    add(std::vector<double>(member.begin(), member.begin() + value.tau.size()));
  } else if constexpr (std::is_same_v<Member, messages::PerRole>) {
    for (std::size_t i = 0; i < member.size(); ++i) {
      add(member[i], fmt::format("[{}]", name(static_cast<messages::Role>(i))));
    }
  } else if constexpr (std::is_same_v<Value, messages::LawSignals>) {
    for (std::size_t i = 0; i < static_cast<std::size_t>(value.num); ++i) {
      add(list(member[i]), fmt::format("[{}]", i));
    }
  } else if constexpr (requires { name(member); }) {
    add(name(member));
  } else if constexpr (std::is_enum_v<Member> || std::is_same_v<Member, std::uint64_t>) {
    add(static_cast<std::int64_t>(member));
  } else {
    add(member);
  }
}

/// Returns "1.5", or "-" for none.
std::string shown(std::optional<double> number) {
  return number ? fmt::format("{:.1f}", *number) : "-";
}

std::string text_of(const MessageField& field) {
  std::string text;
  if (field.value.is_array()) {
    text = fmt::format("[{:.6g}]", fmt::join(field.value.get<std::vector<double>>(), " "));
  } else if (field.value.is_number_float()) {
    text = fmt::format("{:.6g}", field.value.get<double>());
  } else if (field.value.is_string()) {
    const auto& value = field.value.get_ref<const std::string&>();
    std::size_t shown = std::min<std::size_t>(value.size(), 40);
    while (shown < value.size() && shown > 0 && (value[shown] & 0xc0) == 0x80) --shown;
    text =
        fmt::format("\"{}{}\"", printable(value.substr(0, shown)), shown < value.size() ? "…" : "");
  } else {
    text = base::json_text(field.value);
  }
  return fmt::format("{} {}{}{}", field.name, text, field.unit.empty() ? "" : " ", field.unit);
}

template <class Value>
messages::Rejection decode(std::span<const std::byte> message, messages::Stamp& stamp,
                           Value& value) {
  const auto layout = messages::announced_layout<Value>(message);
  if (!layout) return messages::Rejection::wrong_count;
  return messages::Codec<Value>(*layout).decode(message, stamp, value);
}

/// Returns the entry of `map` for `name`, and adds it if there is room. If `most` other names fill
/// the map, it counts one in `beyond` and returns null.
template <class Map>
typename Map::mapped_type* entry(Map& map, std::string_view name, std::size_t most,
                                 std::uint64_t& beyond) {
  auto found = map.find(name);
  if (found == map.end() && map.size() == most) return ++beyond, nullptr;
  if (found == map.end()) found = map.try_emplace(std::string(name)).first;
  return &found->second;
}

}  // namespace

Glance glance(std::span<const std::byte> message, std::vector<MessageField>* fields) {
  Glance glance;
  const auto fingerprint = messages::fingerprint_of(message);
  messages::for_each_type(messages::AllMessages(), [&]<class Value>(
                                                       std::type_identity<Value> /*type*/) {
    if (fingerprint != messages::fingerprint<Value>()) return;
    Value value;
    glance.type = Value::type;
    glance.once_per_tick = messages::once_per_tick<Value>;
    glance.rejection = decode(message, glance.stamp, value);
    if (glance.rejection == messages::Rejection::wrong_size && message.size() > bus::tag_size) {
      const auto untagged = message.first(message.size() - bus::tag_size);
      glance.tagged = decode(untagged, glance.stamp, value) == messages::Rejection::none;
      if (glance.tagged) glance.rejection = messages::Rejection::none;
    }
    if (fields == nullptr || glance.rejection != messages::Rejection::none) return;
    messages::for_each_field<Value>([&](const auto& field) { describe(field, value, *fields); });
  });
  return glance;
}

std::uint64_t BusMonitor::Channel::undecodable() const {
  std::uint64_t count = type.empty() ? 0 : not_ours;
  for (const auto& [reason, times] : rejected) count += times;
  return count;
}

std::uint64_t BusMonitor::undecodable() const {
  std::uint64_t count = 0;
  for (const auto& [name, channel] : channels_) count += channel.undecodable();
  return count;
}

void BusMonitor::take(const bus::Datagram& datagram) {
  ++messages_;
  bytes_ += datagram.payload.size();
  note_sender(datagram.sender, datagram.sequence);
  note_channel(datagram);
}

void BusMonitor::note_sender(std::string_view sender, std::uint32_t sequence) {
  Sender* const found = entry(senders_, sender, max_senders, other_senders_);
  if (found == nullptr) return;
  Sender& known = *found;
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
  const std::int64_t received_ns = datagram.received_ns;
  Channel* const found = entry(channels_, datagram.channel, max_channels, elsewhere_);
  if (found == nullptr) return;
  Channel& channel = *found;
  ++channel.messages;
  channel.bytes += datagram.payload.size();
  channel.now.bytes += datagram.payload.size();
  // A clock that was set back gives a meaningless interval.
  if (channel.last_ns && received_ns >= *channel.last_ns) {
    channel.now.arrivals.add(received_ns - *channel.last_ns);
  }
  channel.last_ns = received_ns;

  const Glance seen = glance(datagram.payload);
  if (seen.type.empty()) {
    ++channel.not_ours;
    return;
  }
  channel.type = seen.type;
  if (seen.rejection != messages::Rejection::none) {
    ++channel.rejected[seen.rejection];
    return;
  }
  if (seen.tagged) ++channel.tagged;
  channel.newest_stamp = seen.stamp;
  channel.newest.assign(datagram.payload.begin(), datagram.payload.end());
  channel.once_per_tick = seen.once_per_tick;
  if (!seen.once_per_tick) return;
  if (seen.stamp.run != channel.run) channel.ticks.start_over();
  channel.run = seen.stamp.run;
  channel.ticks.see(seen.stamp.tick);
}

void BusMonitor::end_interval(double seconds) {
  seconds_ += seconds;
  for (auto& [name, channel] : channels_) {
    channel.shown = std::exchange(channel.now, {});
    channel.shown.seconds = seconds;
  }
}

std::vector<std::string> BusMonitor::table(std::size_t rows) const {
  std::uint64_t missing = 0, tagged = 0;
  for (const auto& [address, sender] : senders_) missing += sender.sequence.missing();
  std::size_t longest_name = 0;
  for (const auto& [name, channel] : channels_) {
    tagged += channel.tagged;
    longest_name = std::max(longest_name, printable(name).size());
  }
  std::vector<std::string> lines = {fmt::format(
      "{} messages of {} senders in {:.1f} s; {} missing by the senders' counts; undecodable {}",
      messages_, senders_.size(), seconds_, missing, undecodable())};
  const auto note = [&](std::uint64_t count, std::string_view what) {
    if (count != 0) lines.push_back(fmt::format("{} {}", count, what));
  };
  note(transport_.overflowed.value_or(0),
       "lost here: this program was too slow for the bus; the true rates are higher");
  note(transport_.malformed, "datagrams that are not LCM messages");
  note(transport_.fragmented, "messages in fragments, which are not reassembled");
  note(tagged, "messages carry the tag of a key, which is not verified here");
  note(elsewhere_, "messages on further channels");
  note(other_senders_, "messages of further senders");

  // The numbers come first: a narrow terminal cuts off the types.
  const std::size_t width = std::max<std::size_t>(7, longest_name);
  const auto add_row = [&](std::string_view channel, const auto&... cells) {
    lines.push_back(fmt::format("{:<{}} {:>9} {:>9} {:>10} {:>8} {:>6} {:>11}  {:.28}", channel,
                                width, cells...));
  };
  lines.emplace_back();
  add_row("channel", "messages", "per s", "jitter us", "kB/s", "gaps", "undecodable", "type");
  for (const auto& [name, channel] : channels_) {
    const std::string_view type = channel.type.empty() ? "not ours" : channel.type;
    add_row(printable(name), channel.messages, shown(channel.shown.arrivals.rate_hz()),
            shown(channel.shown.arrivals.jitter_us()),
            fmt::format("{:.1f}", 1e-3 * channel.shown.bytes_per_s().value_or(0)),
            channel.once_per_tick ? std::to_string(channel.ticks.missing()) : "-",
            channel.undecodable(), type.substr(type.find('.') + 1));
  }
  lines.emplace_back();
  for (const auto& [name, channel] : channels_) {
    if (channel.newest.empty()) continue;
    lines.push_back(
        fmt::format("{:<{}}  tick {}", printable(name), longest_name, channel.newest_stamp.tick));
    std::vector<MessageField> fields;
    glance(channel.newest, &fields);
    for (const MessageField& field : fields) lines.back() += "  " + text_of(field);
  }
  if (rows != 0 && lines.size() > rows) {
    const std::size_t left_out = lines.size() - (rows - 1);
    lines.resize(rows - 1);
    lines.push_back(fmt::format("… {} lines more than this window has", left_out));
  }
  return lines;
}

Json BusMonitor::to_json() const {
  Json channels = Json::array();
  for (const auto& [name, channel] : channels_) channels.push_back(json_of(name, channel));
  Json senders = Json::array();
  for (const auto& [address, sender] : senders_) {
    senders.push_back({{"address", address},
                       {"messages", sender.messages},
                       {"missing", sender.sequence.missing()},
                       {"repeated", sender.sequence.repeated()},
                       {"restarts", sender.sequence.restarts()}});
  }
  return {{"seconds", seconds_},
          {"messages", messages_},
          {"bytes", bytes_},
          {"undecodable", undecodable()},
          {"malformed", transport_.malformed},
          {"fragmented", transport_.fragmented},
          {"lost_here", transport_.overflowed.value_or(0)},
          {"messages_on_further_channels", elsewhere_},
          {"messages_of_further_senders", other_senders_},
          {"senders", std::move(senders)},
          {"channels", std::move(channels)}};
}

Json BusMonitor::json_of(const std::string& name, const Channel& channel) {
  const Traffic& shown = channel.shown;
  const auto or_null = [](bool known, auto value) { return known ? Json(value) : Json(nullptr); };
  const auto number = [](std::optional<double> value) {
    return value ? Json(*value) : Json(nullptr);
  };
  Json because = Json::object();
  for (const auto& [reason, count] : channel.rejected) {
    because[std::string(messages::name(reason))] = count;
  }
  Json newest;
  if (!channel.newest.empty()) {
    newest = {{"utime", channel.newest_stamp.utime},
              {"run", channel.newest_stamp.run},
              {"tick", channel.newest_stamp.tick}};
    std::vector<MessageField> fields;
    glance(channel.newest, &fields);
    for (const MessageField& field : fields) {
      const bool is_text = field.value.is_string();
      newest[field.name] = is_text ? Json(printable(field.value.get<std::string>())) : field.value;
    }
  }
  return {{"channel", printable(name)},
          {"type", or_null(!channel.type.empty(), channel.type)},
          {"messages", channel.messages},
          {"bytes", channel.bytes},
          {"rate_hz", number(shown.arrivals.rate_hz())},
          {"jitter_us", number(shown.arrivals.jitter_us())},
          {"longest_silence_us", shown.arrivals.longest_us()},
          {"bandwidth_bytes_per_s", number(shown.bytes_per_s())},
          {"tick_gaps", or_null(channel.once_per_tick, channel.ticks.missing())},
          {"tick_repeats", or_null(channel.once_per_tick, channel.ticks.repeated())},
          {"undecodable", channel.undecodable()},
          {"undecodable_because", std::move(because)},
          {"tagged", channel.tagged},
          {"not_ours", channel.not_ours},
          {"newest", std::move(newest)}};
}

}  // namespace tachless::live
