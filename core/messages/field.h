#pragma once

#include <cmath>
#include <cstddef>
#include <limits>
#include <string>
#include <string_view>
#include <tuple>

#include "base/quantities.h"

/// Description of messages. A message's type holds one table of fields; its bytes, checks, columns
/// and documentation follow from this table. This header knows no byte order and no particular
/// message. The types are in core/messages/signals.h, core/messages/messages.h and
/// core/messages/truth/. Each type has
///   static constexpr std::string_view type;    // LCM's name, "tachless.tick_t"
///   static constexpr std::string_view suffix;  // of its channel, "TICK"
///   static constexpr auto fields;              // std::tuple of Field, in the order of the .lcm
///                                              // file, without utime, run, tick and the counts
///   static constexpr std::size_t max_size;     // optional: most bytes of a message
namespace tachless::messages {

/// Type of a field's values in a message.
enum class Kind {
  real,  ///< IEEE 754 double, finite
  flag,  ///< boolean: one byte, 0 or 1
  int64,
  int32,
  int8,
  uint8,  ///< sent as LCM's int8_t, because LCM has no unsigned type
  text,
};

/// Number of values of a field.
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

  std::string_view name;    ///< name in the .lcm file
  std::string_view symbol;  ///< symbol in columns and equations
  std::string_view unit;    ///< unit for revolute joints; empty: no unit
  Kind kind;
  Count count;
  Member Value::*member;
  std::string_view meaning = {};
  double lowest = -no_limit;  ///< smallest value allowed, of numbers
  double highest = no_limit;  ///< greatest value allowed, of numbers
  std::size_t longest = 0;    ///< most characters, of texts
  bool lines = false;         ///< a text may have line ends and tabs, because it is a file
};

/// Calls `f(field)` for each field of the message, in order.
template <class Value, class F>
constexpr void for_each_field(F&& f) {
  std::apply([&](const auto&... field) { (f(field), ...); }, Value::fields);
}

/// Returns whether the message has a field with this count.
template <class Value>
constexpr bool has_count(Count count) {
  bool found = false;
  for_each_field<Value>([&](const auto& field) { found = found || field.count == count; });
  return found;
}

/// Returns whether the message has a field of that name.
template <class Value>
constexpr bool has_field(std::string_view name) {
  bool found = false;
  for_each_field<Value>([&](const auto& field) { found = found || field.name == name; });
  return found;
}

/// Returns whether the message begins with int32 counts: signal rows, then joints, then motors.
template <class Value>
constexpr bool has_joint_count() {
  return has_count<Value>(Count::joints) || has_count<Value>(Count::signals);
}

template <class Value>
concept Described = requires {
  Value::fields;
};

/// Returns true if no number in the value is NaN or infinite. A node checks its results with it
/// before it encodes them, and stops with a fault if the check fails.
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

/// Returns the prefix of a robot's channel names: the robot's name in upper case.
inline std::string channel_prefix(std::string robot) {
  for (char& c : robot) {
    if (c >= 'a' && c <= 'z') c = static_cast<char>(c - 'a' + 'A');
  }
  return robot;
}

/// Returns the full channel name, e.g. "ARM_POSITION". The suffix comes from the type, never from
/// an option.
/// @param robot a `channel_prefix`
inline std::string channel(std::string_view robot, std::string_view suffix) {
  return std::string(robot) + "_" + std::string(suffix);
}
template <class Value>
std::string channel(std::string_view robot) {
  return channel(robot, Value::suffix);
}

/// Returns a field with one number per joint; the functions below build the other fields of the
/// tables.
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
/// Returns the field of a text that is a file and may have several lines.
template <class Value, class Member>
constexpr auto file(std::string_view name, std::size_t longest, Member Value::*member) {
  auto field = text<Value, Member>(name, longest, member);
  field.lines = true;
  return field;
}

}  // namespace tachless::messages
