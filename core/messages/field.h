#pragma once

#include <cmath>
#include <cstddef>
#include <limits>
#include <string>
#include <string_view>
#include <tuple>

#include "base/quantities.h"

/// How a message is described: its type holds one table of fields, from which its bytes, checks,
/// columns and descriptions follow. Knows no byte order and no message in particular; the types are
/// in core/messages/signals.h, core/messages/messages.h and core/messages/truth/plant_truth.h. Each
/// has
///   static constexpr std::string_view type;    // LCM's name, "tachless.tick_t"
///   static constexpr std::string_view suffix;  // of its channel, "TICK"
///   static constexpr auto fields;              // std::tuple of Field, in the order of the .lcm
///                                              // file, without utime, run, tick and the counts
///   static constexpr std::size_t max_size;     // optional: most bytes of a message
namespace tachless::messages {

/// How one value of a field is sent.
enum class Kind {
  real,  ///< IEEE 754 double, finite
  flag,  ///< boolean: one byte, 0 or 1
  int64,
  int32,
  int8,
  uint8,  ///< sent as LCM's int8_t, for want of an unsigned one
  text,
};

/// How many values a field has.
enum class Count {
  one,
  joints,   ///< one per joint
  motors,   ///< one per joint of a flexible-joint robot, none on a rigid one
  signals,  ///< one per joint, in as many rows as the law declares signals
  roles,    ///< one per role, in the order of messages::Role
};

constexpr double no_limit = std::numeric_limits<double>::infinity();

/// One field of `Value`'s message.
template <class Value, class MemberType>
struct Field {
  using Member = MemberType;

  std::string_view name;    ///< in the .lcm file
  std::string_view symbol;  ///< in columns and equations
  std::string_view unit;    ///< of revolute joints; empty when it has none
  Kind kind;
  Count count;
  Member Value::*member;
  std::string_view meaning = {};
  double lowest = -no_limit;  ///< smallest value allowed, of numbers
  double highest = no_limit;  ///< greatest
  std::size_t longest = 0;    ///< most characters, of texts
  bool lines = false;         ///< a text may have line ends and tabs: it is a file
};

/// Calls `f(field)` for each field of the message, in order.
template <class Value, class F>
constexpr void for_each_field(F&& f) {
  std::apply([&](const auto&... field) { (f(field), ...); }, Value::fields);
}

/// Whether any field is counted so.
template <class Value>
constexpr bool has_count(Count count) {
  bool found = false;
  for_each_field<Value>([&](const auto& field) { found = found || field.count == count; });
  return found;
}

/// Whether the message has a field of that name.
template <class Value>
constexpr bool has_field(std::string_view name) {
  bool found = false;
  for_each_field<Value>([&](const auto& field) { found = found || field.name == name; });
  return found;
}

/// Signal rows, then joints, then motors: the int32 counts that the message begins with.
template <class Value>
constexpr bool has_joint_count() {
  return has_count<Value>(Count::joints) || has_count<Value>(Count::signals);
}

template <class Value>
concept Described = requires {
  Value::fields;
};

/// True when no number in the value is NaN or infinite. A node asks before it encodes what it
/// has computed, and stops with a fault of its own if the answer is no.
template <Described Value>
bool all_finite(const Value& value) {
  bool result = true;
  for_each_field<Value>([&](const auto& field) {
    const auto& member = value.*field.member;
    if constexpr (requires { std::isfinite(member); }) {
      result = result && std::isfinite(member);
    } else if constexpr (requires { member.allFinite(); }) {
      result = result && member.allFinite();
    } else if constexpr (requires { member[0].allFinite(); }) {
      for (const auto& row : member) result = result && row.allFinite();
    }
  });
  return result;
}

/// What the names of a robot's channels begin with: its name in upper case.
inline std::string channel_prefix(std::string robot) {
  for (char& c : robot) {
    if (c >= 'a' && c <= 'z') c = static_cast<char>(c - 'a' + 'A');
  }
  return robot;
}

/// Full channel name, e.g. "ARM_POSITION": from the type, never from an option. `robot` is a
/// `channel_prefix`.
inline std::string channel(std::string_view robot, std::string_view suffix) {
  return std::string(robot) + "_" + std::string(suffix);
}
template <class Value>
std::string channel(std::string_view robot) {
  return channel(robot, Value::suffix);
}

/// Makers of fields, for the tables.
template <class Value>
constexpr auto per_joint(std::string_view name, std::string_view symbol, std::string_view unit,
                         Vector Value::*member, std::string_view meaning) {
  return Field<Value, Vector>{name, symbol, unit, Kind::real, Count::joints, member, meaning};
}
template <class Value>
constexpr auto per_motor(std::string_view name, std::string_view symbol, std::string_view unit,
                         Vector Value::*member, std::string_view meaning) {
  return Field<Value, Vector>{name, symbol, unit, Kind::real, Count::motors, member, meaning};
}
template <class Value, class Member>
constexpr auto number(std::string_view name, std::string_view unit, Kind kind,
                      Member Value::*member, double lowest = -no_limit, double highest = no_limit) {
  return Field<Value, Member>{name, name, unit, kind, Count::one, member, {}, lowest, highest};
}
template <class Value, class Member>
constexpr auto per_role(std::string_view name, Member Value::*member) {
  return Field<Value, Member>{name, name, {}, Kind::int64, Count::roles, member};
}
template <class Value, class Member>
constexpr auto text(std::string_view name, std::size_t longest, Member Value::*member) {
  return Field<Value, Member>{name,   name, {},        Kind::text, Count::one,
                              member, {},   -no_limit, no_limit,   longest};
}
/// A text that is a file: it may have several lines.
template <class Value, class Member>
constexpr auto file(std::string_view name, std::size_t longest, Member Value::*member) {
  auto field = text<Value, Member>(name, longest, member);
  field.lines = true;
  return field;
}

}  // namespace tachless::messages
