#include "tests/campaign/forger.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <limits>
#include <string>
#include <type_traits>

#include "messages/codec.h"
#include "messages/messages.h"
#include "messages/truth/arm_torque.h"
#include "messages/truth/contact.h"
#include "messages/truth/plant_truth.h"

namespace tachless::campaign {
namespace {

using messages::Count;
using messages::Kind;

constexpr messages::Layout layout{.num_joints = 2, .num_motors = 0, .num_signals = 2};

std::size_t entries_of(Count count) {
  const int rows = count == Count::signals ? layout.num_signals : 1;
  return static_cast<std::size_t>(rows * messages::detail::length_of(count, layout));
}

std::uint64_t get(std::span<const std::byte> bytes) {
  std::uint64_t value = 0;
  for (const std::byte each : bytes) value = value << 8 | std::to_integer<std::uint64_t>(each);
  return value;
}

void put(std::uint64_t value, std::span<std::byte> bytes) {
  for (std::size_t i = bytes.size(); i-- > 0; value >>= 8) bytes[i] = static_cast<std::byte>(value);
}

class FieldList {
 public:
  explicit FieldList(std::span<const std::byte> payload) : payload_(payload) {}

  void add(std::string_view name, Kind kind, std::size_t size) {
    if (offset_ + size > payload_.size()) size = 0;
    if (size > 0) fields_.push_back({name, offset_, size, kind});
    offset_ += size;
  }
  void add_text(std::string_view name) {
    const std::size_t before = offset_;
    add("length", Kind::int32, sizeof(std::int32_t));
    if (offset_ == before) return;
    const auto length = get(payload_.subspan(before, sizeof(std::int32_t)));
    if (length > 1) add(name, Kind::text, length - 1);
    if (length > 0) ++offset_;
  }
  std::vector<FieldAt> take() { return std::move(fields_); }

 private:
  std::span<const std::byte> payload_;
  std::size_t offset_ = 0;
  std::vector<FieldAt> fields_;
};

template <class Value>
void list(FieldList& to) {
  for (const auto* name : {"fingerprint", "utime", "run", "tick"}) to.add(name, Kind::int64, 8);
  if constexpr (messages::has_count<Value>(Count::signals)) to.add("num_signals", Kind::int32, 4);
  if constexpr (messages::has_joint_count<Value>()) to.add("num_joints", Kind::int32, 4);
  if constexpr (messages::has_count<Value>(Count::motors)) to.add("num_motors", Kind::int32, 4);
  messages::for_each_field<Value>([&](const auto& field) {
    if (field.kind == Kind::text) return to.add_text(field.name);
    for (std::size_t i = 0; i < entries_of(field.count); ++i) {
      to.add(field.name, field.kind, messages::detail::size_of(field.kind));
    }
  });
}

}  // namespace

std::vector<FieldAt> fields_of(std::string_view channel, std::span<const std::byte> payload) {
  FieldList fields(payload);
  const auto list_if = [&]<class Value>(std::type_identity<Value>) {
    if (channel == messages::channel<Value>("ARM")) list<Value>(fields);
  };
  messages::for_each_type(messages::Messages(), list_if);
  list_if(std::type_identity<messages::truth::PlantTruth>());
  list_if(std::type_identity<messages::truth::Contact>());
  list_if(std::type_identity<messages::truth::ArmTorque>());
  return fields.take();
}

void Forger::change(std::span<std::byte> value, Kind kind) {
  using Int = std::numeric_limits<std::int64_t>;
  using Real = std::numeric_limits<double>;
  const std::uint64_t old = get(value);
  if (kind == Kind::text) {
    const auto some = value.subspan(below(value.size()));
    for (std::byte& each : some) each = static_cast<std::byte>(1 + below(255));
    return;
  }
  if (kind == Kind::real) {
    const double was = std::bit_cast<double>(old);
    const std::array extremes = {0.0,
                                 -0.0,
                                 1.0,
                                 Real::quiet_NaN(),
                                 Real::infinity(),
                                 -Real::infinity(),
                                 Real::max(),
                                 -Real::max(),
                                 1e154,
                                 Real::denorm_min(),
                                 was + 1,
                                 std::bit_cast<double>(old ^ 1)};
    return put(std::bit_cast<std::uint64_t>(extremes.at(below(extremes.size()))), value);
  }
  const std::array<std::uint64_t, 10> extremes = {
      0,
      std::uint64_t(-1),
      std::uint64_t(Int::min()) >> 8 * (8 - value.size()),
      (std::uint64_t(Int::max()) << 1) >> (8 * (8 - value.size()) + 1),
      old + 1,
      old - 1,
      old + 1000,
      2 + below(4),
      0x20000000,
      random_()};
  put(extremes.at(below(extremes.size())), value);
}

std::vector<std::byte> Forger::forge(const Sent& honest) {
  auto forged = honest.payload;
  const auto fields = fields_of(honest.channel, forged);
  if (fields.empty()) return forged;
  const auto bytes_of = [&](const FieldAt& field) {
    return std::span(forged).subspan(field.offset, field.size);
  };
  // An announcement that is not newer than its sender's last counts as a copy, so most forged ones
  // are newer.
  const auto counter = std::ranges::find(fields, "counter", &FieldAt::name);
  if (counter != fields.end() && below(4) != 0) {
    put(get(bytes_of(*counter)) + (below(8) == 0 ? 1'000'000 : 1), bytes_of(*counter));
  }
  do {
    const FieldAt& field = fields[below(fields.size())];
    change(bytes_of(field), field.kind);
  } while (below(3) == 0);
  return forged;
}

std::vector<std::byte> Forger::contradict(const Sent& honest) {
  auto forged = honest.payload;
  const auto fields = fields_of(honest.channel, forged);
  const bool announcement = honest.channel == messages::channel<messages::Participant>("ARM");
  for (auto field = fields.rbegin(); field != fields.rend(); ++field) {
    const auto bytes = std::span(forged).subspan(field->offset, field->size);
    if (announcement) {
      if (field->name == "counter") put(get(bytes) + 1, bytes);
      if (field->name != "state") continue;
      put(below(5), bytes);
      break;
    }
    if (field->kind == Kind::text || field->name == "fault") continue;
    put(get(bytes) ^ 1, bytes);
    break;
  }
  return forged;
}

std::vector<std::byte> Forger::name(const Sent& honest) {
  static const std::array<std::string, 8> weapons = {
      "error:rad,nu:rad/s\n!touch PWNED\n#",
      "error:rad\n!touch PWNED\n#,nu:rad/s",
      "error:`touch PWNED`,nu:$(touch PWNED)",
      "<script>document.title='PWNED'</script>:rad,\"onload=x:rad",
      "=cmd|' /C touch PWNED'!A0:rad,@nu:rad/s",
      "\x1b]0;PWNED\x07:rad,\x1b[2J:rad",
      "../../../../tmp/PWNED:rad,%s%n:rad",
      std::string(4000, 'n') + ":rad"};
  auto named = honest.payload;
  std::vector<FieldAt> texts;
  for (const FieldAt& field : fields_of(honest.channel, named)) {
    if (field.name == "counter") {
      const auto bytes = std::span(named).subspan(field.offset, field.size);
      put(get(bytes) + 1, bytes);
    }
    if (field.kind == Kind::text) texts.push_back(field);
  }
  if (texts.empty()) return named;
  const FieldAt& at = texts[below(texts.size())];
  const std::string& weapon = weapons.at(below(weapons.size()));
  const auto begin = named.begin() + static_cast<std::ptrdiff_t>(at.offset);
  named.erase(begin, begin + static_cast<std::ptrdiff_t>(at.size));
  const auto bytes = std::as_bytes(std::span(weapon));
  named.insert(named.begin() + static_cast<std::ptrdiff_t>(at.offset), bytes.begin(), bytes.end());
  // The length counts the NUL and stands before the text.
  constexpr std::size_t length = sizeof(std::int32_t);
  put(weapon.size() + 1, std::span(named).subspan(at.offset - length, length));
  return named;
}

std::vector<std::byte> Forger::garbage() {
  std::vector<std::byte> bytes(below(10) == 0 ? below(60'000) : below(600));
  for (std::byte& each : bytes) each = static_cast<std::byte>(random_());
  return bytes;
}

std::vector<std::byte> Forger::damage(const Sent& honest) {
  auto damaged = honest.payload;
  switch (below(3)) {
    case 0:
      damaged.resize(below(damaged.size()));
      break;
    case 1:
      damaged.resize(damaged.size() + 1 + below(64), static_cast<std::byte>(random_()));
      break;
    default:
      for (std::uint64_t flips = 1 + below(4); flips > 0 && !damaged.empty(); --flips) {
        damaged[below(damaged.size())] ^= static_cast<std::byte>(1U << below(8));
      }
  }
  return damaged;
}

}  // namespace tachless::campaign
