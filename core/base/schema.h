#pragma once

#include <array>
#include <cstddef>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <tuple>
#include <type_traits>
#include <variant>
#include <vector>

#include "base/quantities.h"

/// Named values. A struct that is filled from outside, such as the gains of a law, declares one
/// `Key` for each of its members:
///
///   struct Gains {
///     Vector kp;
///     double cutoff_hz = 50;
///     static constexpr std::tuple keys{
///         base::Key{"kp", &Gains::kp, "N m/rad", "Proportional gain"}.in(base::positive),
///         base::Key{"cutoff_hz", &Gains::cutoff_hz, "Hz", "Cut-off"}.by_default()};
///   };
///
/// Reading, checking, error messages and documentation follow from the keys. This header does not
/// read anything itself (core/scenario/ reads YAML).
namespace tachless::base {

/// The numbers that a value may take; they never include NaN or infinities.
struct Range {
  double min = -std::numeric_limits<double>::infinity();
  double max = std::numeric_limits<double>::infinity();
  bool min_open = false;  ///< min itself is not allowed
  bool max_open = false;
  bool whole = false;  ///< whole numbers only; min and max are finite then

  [[nodiscard]] constexpr bool contains(double value) const {
    constexpr double infinity = std::numeric_limits<double>::infinity();
    return -infinity < value && value < infinity && (min_open ? value > min : value >= min) &&
           (max_open ? value < max : value <= max) &&
           (!whole || value == static_cast<double>(static_cast<long long>(value)));
  }
  /// Returns e.g. "in (0, 1]", ">= 0", "> 0"; empty when every finite number is allowed.
  [[nodiscard]] std::string text() const;
};

inline constexpr Range positive{0, std::numeric_limits<double>::infinity(), true, false};
inline constexpr Range not_negative{0, std::numeric_limits<double>::infinity(), false, false};

/// Returns the whole numbers from `low` to `high`.
constexpr Range whole(double low, double high) { return {low, high, false, false, true}; }

// An enum declares the names of its values in files beside itself, in its namespace and in its
// order:
//   enum class Side { link, motor };
//   constexpr std::array<std::string_view, 2> names(Side /*type*/) { return {"link", "motor"}; }

/// Returns the name of `value`; "?" when it has none.
template <class Enum>
constexpr std::string_view name_of(Enum value) {
  constexpr auto all = names(Enum());
  const auto at = static_cast<std::size_t>(value);
  return at < all.size() ? all[at] : "?";
}

/// Returns all values of an enum.
template <class Enum>
constexpr auto values_of() {
  std::array<Enum, names(Enum()).size()> all{};
  for (std::size_t i = 0; i < all.size(); ++i) all[i] = static_cast<Enum>(i);
  return all;
}

/// Returns the value called `name`; nothing when there is none.
template <class Enum>
constexpr std::optional<Enum> value_of(std::string_view name) {
  for (const Enum value : values_of<Enum>()) {
    if (name_of(value) == name) return value;
  }
  return std::nullopt;
}

/// Default of a value that is not given.
enum class Default {
  required,   ///< there is none: the value must be given
  of_struct,  ///< the struct's own initial value
  of_joints,  ///< one number, for every joint
  described,  ///< the user of the value decides; the member stays as the struct initialises it
};

/// The declaration of one value. `Member` is the type of a data member, or a function type
/// `void(Value)` when the struct takes the value through a member function.
template <class Struct, class Member>
struct Key {
  std::string_view name;
  Member Struct::*member;
  std::string_view unit{};
  std::string_view meaning{};  ///< one line for the documentation; may use Markdown
  Range range{};
  Default fallback = Default::required;
  double each_joint = 0;                 ///< value of Default::of_joints
  std::string_view described_default{};  ///< text of Default::described
  bool nullable = false;

  constexpr Key(std::string_view key_name, Member Struct::*filled, std::string_view key_unit = {},
                std::string_view key_meaning = {})
      : name(key_name), member(filled), unit(key_unit), meaning(key_meaning) {}

  /// Returns the key with these allowed numbers. For vectors and lists they hold for each entry.
  [[nodiscard]] constexpr Key in(Range allowed) const {
    Key key = *this;
    key.range = allowed;
    return key;
  }
  /// Returns the key of an optional value: the member then keeps the struct's own initial value.
  [[nodiscard]] constexpr Key by_default() const {
    Key key = *this;
    key.fallback = Default::of_struct;
    return key;
  }
  /// Returns the key of an optional value: the vector then has this number for every joint.
  [[nodiscard]] constexpr Key by_default(double for_each_joint) const {
    static_assert(std::is_same_v<Member, Vector>, "others have their default in the struct");
    Key key = *this;
    key.fallback = Default::of_joints;
    key.each_joint = for_each_joint;
    return key;
  }
  /// Returns the key of an optional value, with words for what happens without it.
  [[nodiscard]] constexpr Key by_default(std::string_view in_words) const {
    Key key = *this;
    key.fallback = Default::described;
    key.described_default = in_words;
    return key;
  }
  /// Returns the key of a value that may be `null`, which gives an empty std::optional.
  [[nodiscard]] constexpr Key or_null() const {
    Key key = *this;
    key.nullable = true;
    return key;
  }
};

/// True for a struct that declares `keys`.
template <class Struct, class = void>
inline constexpr bool has_keys = false;
template <class Struct>
inline constexpr bool has_keys<Struct, std::void_t<decltype(Struct::keys)>> = true;

/// Calls `visit` with each key of `Struct`, in their order.
template <class Struct, class Visit>
constexpr void for_each_key(Visit&& visit) {
  std::apply([&](const auto&... key) { (visit(key), ...); }, Struct::keys);
}

/// A rule across several keys that a filled struct breaks. The struct's member function
/// `std::optional<base::Refusal> refusal() const`, if it has one, returns it.
struct Refusal {
  std::string key;      ///< "name", "map.name"
  std::string problem;  ///< "<value>; allowed: <…>"
};

// ---- shapes of members ------------------------------------------------------------------------

enum class Shape {
  text,
  choice,         ///< an enum with names
  yes_no,         ///< bool
  number,         ///< double
  whole,          ///< any integer
  matrix,         ///< Matrix: a list of rows, or its diagonal as joints
  joints,         ///< Vector: one number for every joint, or a list with one per joint
  numbers,        ///< list of numbers
  joints_list,    ///< list of `joints`
  named_joints,   ///< map from names of the user's choice to `joints`
  named_numbers,  ///< map from names of the user's choice to numbers
  named_texts,    ///< map from names of the user's choice to texts
  one_of,         ///< std::variant of structs that have `name` and `keys`
  map,            ///< struct that has `keys`
  list_of_maps,   ///< list of such structs
};

/// The type of the value behind a key's `Member`: without std::optional, the argument of a setter.
template <class Member>
struct ValueOf {
  using Type = Member;
};
template <class T>
struct ValueOf<std::optional<T>> : ValueOf<T> {};
template <class T>
struct ValueOf<void(T)> : ValueOf<T> {};

/// True if `T` is made by `Template`: a list or an alternative.
template <template <class...> class Template, class T>
inline constexpr bool is_made_by = false;
template <template <class...> class Template, class... T>
inline constexpr bool is_made_by<Template, Template<T...>> = true;

template <class Member>
constexpr Shape shape_of_member() {
  using T = typename ValueOf<Member>::Type;
  if constexpr (std::is_enum_v<T>) return Shape::choice;
  if constexpr (std::is_same_v<T, bool>) return Shape::yes_no;
  if constexpr (std::is_floating_point_v<T>) return Shape::number;
  if constexpr (std::is_integral_v<T>) return Shape::whole;
  if constexpr (std::is_same_v<T, std::string>) return Shape::text;
  if constexpr (std::is_same_v<T, Matrix>) return Shape::matrix;
  if constexpr (std::is_same_v<T, Vector>) return Shape::joints;
  if constexpr (std::is_same_v<T, std::vector<double>>) return Shape::numbers;
  if constexpr (std::is_same_v<T, std::vector<Vector>>) return Shape::joints_list;
  if constexpr (std::is_same_v<T, std::map<std::string, Vector>>) return Shape::named_joints;
  if constexpr (std::is_same_v<T, std::map<std::string, double>>) return Shape::named_numbers;
  if constexpr (std::is_same_v<T, std::map<std::string, std::string>>) return Shape::named_texts;
  if constexpr (is_made_by<std::vector, T>) return Shape::list_of_maps;
  if constexpr (is_made_by<std::variant, T>) return Shape::one_of;
  return Shape::map;
}

/// Shape of values of type `Member`. An optional has the shape of its content.
template <class Member>
inline constexpr Shape shape_of = shape_of_member<Member>();

/// Returns the allowed values of that shape: "a finite number in (0, 1]". `choices` are the
/// names of a choice or of the alternatives.
std::string allowed_text(Shape shape, const Range& range,
                         const std::vector<std::string_view>& choices = {}, bool nullable = false);

/// Returns the names among which a value chooses; empty for a value that is no choice.
template <class T>
std::vector<std::string_view> choices_of(const T* /*type*/) {
  if constexpr (std::is_enum_v<T>) {
    constexpr auto all = names(T());
    return {all.begin(), all.end()};
  } else {
    return {};
  }
}
template <class... T>
std::vector<std::string_view> choices_of(const std::variant<T...>* /*type*/) {
  return {T::name...};
}

/// Returns the allowed values of `key`.
template <class Struct, class Member>
std::string allowed_text(const Key<Struct, Member>& key) {
  const auto choices = choices_of(static_cast<typename ValueOf<Member>::Type*>(nullptr));
  const std::string text = allowed_text(shape_of<Member>, key.range, choices, key.nullable);
  // An alternative that needs no values of its own may be given by its name.
  const bool name_alone = shape_of<Member> == Shape::one_of && key.fallback == Default::of_struct;
  return name_alone ? std::string(choices.front()) + ", or " + text : text;
}

}  // namespace tachless::base
