#pragma once

#include <array>
#include <optional>
#include <string_view>
#include <type_traits>
#include <variant>

#include "messages/messages.h"

/// The list of the measurements that a controller can receive. Each measurement declares its
/// content in a table of fields. Each law chooses its measurement.
namespace tachless::messages {

/// The types of measurements.
using Measurements = TypeList<PositionMeasurement, MotorPositionMeasurement,
                              BothPositionsMeasurement, LinkStateMeasurement, StateMeasurement>;

namespace detail {

template <class List>
struct Of;
template <class... M>
struct Of<TypeList<M...>> {
  using Any = std::variant<M...>;
  template <template <class...> class Wrap>
  using Each = std::variant<Wrap<M>...>;
  static constexpr std::array suffixes = {M::suffix...};
};

}  // namespace detail

using AnyMeasurement = detail::Of<Measurements>::Any;  ///< a measurement of any type

/// One of `Wrap<M>` for the measurements M.
template <template <class...> class Wrap>
using EachMeasurement = detail::Of<Measurements>::Each<Wrap>;

/// Channel suffixes, in the order of `Measurements`.
inline constexpr auto measurement_suffixes = detail::Of<Measurements>::suffixes;

/// True if M is one of these types.
template <class M>
constexpr bool is_measurement = std::is_constructible_v<AnyMeasurement, std::in_place_type_t<M>>;

template <class M>
constexpr bool holds_links = has_field<M>("position");  ///< true if M has links' positions
template <class M>
constexpr bool holds_motors = has_field<M>("motor_position");  ///< true if M has motors' positions

/// Parts of the plant's state, and hence of a law's measurement.
enum class Part { q = 0, v = 1, theta = 2, thetadot = 3 };

/// Returns the vectors of a measurement, of one type or any, by `Part`; null for a part that it
/// does not have.
template <class M>
auto parts_of(M& measurement) {
  using Vector = std::conditional_t<std::is_const_v<M>, const Vector, Vector>;
  std::array<Vector*, 4> parts{};
  const auto take = [&](auto& each) {
    if constexpr (requires { each.q; }) parts[0] = &each.q;
    if constexpr (requires { each.v; }) parts[1] = &each.v;
    if constexpr (requires { each.theta; }) parts[2] = &each.theta;
    if constexpr (requires { each.thetadot; }) parts[3] = &each.thetadot;
  };
  if constexpr (is_measurement<std::remove_const_t<M>>) {
    take(measurement);
  } else {
    std::visit(take, measurement);
  }
  return parts;
}

/// Returns the positions of the links; empty if the measurement holds none [rad; m].
inline Vector links_of(const AnyMeasurement& measurement) {
  const Vector* const q = parts_of(measurement)[0];
  return q == nullptr ? Vector() : *q;
}

/// Calls `f(std::type_identity<M>())` for the measurement of that channel suffix.
/// @return false if there is no such measurement
template <class F>
constexpr bool with_measurement(std::string_view suffix, F&& f) {
  bool found = false;
  for_each_type(Measurements(), [&]<class M>(std::type_identity<M> type) {
    if (M::suffix != suffix) return;
    found = true;
    f(type);
  });
  return found;
}

/// Returns an empty measurement of that channel suffix; nullopt if there is none.
inline std::optional<AnyMeasurement> measurement_of(std::string_view suffix) {
  std::optional<AnyMeasurement> made;
  with_measurement(suffix, [&]<class M>(std::type_identity<M> /*type*/) { made = M(); });
  return made;
}

/// Returns whether the measurement of that channel suffix holds a velocity.
constexpr bool measures_velocity(std::string_view suffix) {
  bool result = false;
  with_measurement(suffix, [&]<class M>(std::type_identity<M>) {
    result = has_field<M>("velocity") || has_field<M>("motor_velocity");
  });
  return result;
}

/// Returns whether `Had` has every field of `Wanted`, so that `part_of` can extract `Wanted`.
template <class Wanted, class Had>
constexpr bool is_part_of() {
  bool all = true;
  for_each_field<Wanted>([&](const auto& field) { all = all && has_field<Had>(field.name); });
  return all;
}

/// Returns the part of `had` that `Wanted` holds. Precondition: `is_part_of<Wanted, Had>()`.
template <class Wanted, class Had>
Wanted part_of(const Had& had) {
  static_assert(is_part_of<Wanted, Had>());
  Wanted wanted;
  for_each_field<Wanted>([&](const auto& to) {
    for_each_field<Had>([&](const auto& from) {
      if (to.name == from.name) wanted.*to.member = had.*from.member;
    });
  });
  return wanted;
}

/// Returns the point on the straight line from `a` (share 0) to `b` (share 1), for each field of
/// numbers.
template <class Value>
Value between(const Value& a, const Value& b, double share) {
  Value result;
  for_each_field<Value>([&]<class Member>(const Field<Value, Member>& field) {
    if constexpr (!std::is_same_v<Member, std::string>) {
      result.*field.member = a.*field.member + share * (b.*field.member - a.*field.member);
    }
  });
  return result;
}

}  // namespace tachless::messages
