#include "monitor/message_reader.h"

#include <fmt/core.h>

#include <array>
#include <optional>
#include <stdexcept>
#include <type_traits>
#include <utility>

#include "bus/authenticated.h"
#include "bus/truth/truth_wire.h"
#include "logger/message_types.h"

namespace tachless::monitor {
namespace {

using Fields = std::vector<MessageField>;

std::vector<double> list(const robot::Vector& x) { return {x.begin(), x.end()}; }

/// Appends what a reader of the bus wants to see of one field.
template <class Value, class Member>
void describe(const loop::Field<Value, Member>& field, const Value& value, Fields& fields) {
  const Member& member = value.*field.member;
  const auto add = [&](auto shown) {
    fields.push_back({std::string(field.name), field.unit, std::move(shown)});
  };
  if constexpr (std::is_same_v<Member, robot::Vector>) {
    add(list(member));
  } else if constexpr (std::is_same_v<Member, std::array<bool, robot::max_joints>>) {
    add(std::vector<double>(member.begin(), member.begin() + value.tau.size()));
  } else if constexpr (std::is_same_v<Member, loop::PerRole>) {
    for (std::size_t i = 0; i < member.size(); ++i) {
      fields.push_back(
          {fmt::format("{}[{}]", field.name, name(static_cast<loop::Role>(i))), "", member[i]});
    }
  } else if constexpr (std::is_same_v<Value, loop::LawSignals>) {
    for (std::size_t i = 0; i < static_cast<std::size_t>(value.num); ++i) {
      fields.push_back({fmt::format("{}[{}]", field.name, i), field.unit, list(member[i])});
    }
  } else if constexpr (requires { name(member); }) {
    add(std::string(name(member)));
  } else if constexpr (std::is_same_v<Member, double> || std::is_same_v<Member, bool> ||
                       std::is_same_v<Member, std::string>) {
    add(member);
  } else {
    add(static_cast<std::int64_t>(member));
  }
}

}  // namespace

class MessageReader::OfType {
 public:
  OfType(std::string_view its_type, bool every_tick) : type(its_type), once_per_tick(every_tick) {}
  OfType(const OfType&) = delete;
  OfType& operator=(const OfType&) = delete;
  virtual ~OfType() = default;

  virtual bus::Rejection decode(std::span<const std::byte> message, loop::Stamp& stamp) = 0;
  /// Of the message decoded last.
  [[nodiscard]] virtual Fields fields() const = 0;

  const std::string_view type;
  const bool once_per_tick;
};

template <class Value>
class MessageReader::Reader final : public OfType {
 public:
  using OfType::OfType;

  bus::Rejection decode(std::span<const std::byte> message, loop::Stamp& stamp) override {
    const auto layout = bus::announced_layout<Value>(message);
    if (!layout) return bus::Rejection::wrong_count;
    if (!codec_ || *layout != layout_) {
      codec_.emplace(*layout);
      layout_ = *layout;
    }
    return codec_->decode(message, stamp, value_);
  }

  [[nodiscard]] Fields fields() const override {
    Fields fields;
    loop::for_each_field<Value>([&](const auto& field) { describe(field, value_, fields); });
    return fields;
  }

 private:
  loop::Layout layout_;
  std::optional<bus::Codec<Value>> codec_;
  Value value_;
};

MessageReader::MessageReader() {
  const auto add = [&]<class Value>(std::type_identity<Value>) {
    using Message = loop::MessageOf<Value>;
    readers_.push_back(std::make_unique<Reader<Value>>(Message::type, Message::once_per_tick));
  };
  for_each_type(loop::Messages(), add);
  add(std::type_identity<loop::truth::PlantTruth>());
}

MessageReader::~MessageReader() = default;

MessageReader::OfType* MessageReader::reader_of(std::string_view type) const {
  for (const auto& reader : readers_) {
    if (reader->type == type) return reader.get();
  }
  return nullptr;
}

MessageReader::Glance MessageReader::glance(std::span<const std::byte> message) {
  Glance glance;
  glance.type = logger::type_name(message);
  if (glance.type.empty()) return glance;
  OfType* reader = reader_of(glance.type);
  if (reader == nullptr) throw std::logic_error(fmt::format("no reader for {}", glance.type));
  glance.once_per_tick = reader->once_per_tick;
  glance.rejection = reader->decode(message, glance.stamp);
  if (glance.rejection == bus::Rejection::wrong_size && message.size() > bus::tag_size) {
    const auto untagged = message.first(message.size() - bus::tag_size);
    glance.tagged = reader->decode(untagged, glance.stamp) == bus::Rejection::none;
    if (glance.tagged) glance.rejection = bus::Rejection::none;
  }
  return glance;
}

std::vector<MessageField> MessageReader::fields(std::span<const std::byte> message) {
  const Glance seen = glance(message);
  if (seen.type.empty() || seen.rejection != bus::Rejection::none) {
    throw std::logic_error("MessageReader: fields of a message that cannot be read");
  }
  return reader_of(seen.type)->fields();
}

}  // namespace tachless::monitor
