#pragma once

#include <concepts>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

#include "base/schema.h"
#include "scenario/scenario.h"
#include "scenario/yaml_tree.h"

/// Reading of any struct with keys (core/base/schema.h) from a tree of YAML. A key that the struct
/// does not declare is refused. This header knows no rule between structs (scenario_rules.cpp).
namespace tachless::scenario {

/// A value, or a missing value, and its place in the scenario.
struct Place {
  const Scenario& scenario;  ///< gives line numbers and the number of joints
  const YamlNode* node;      ///< null: not given
  std::string path;          ///< "loop.period_s"; empty for the whole scenario

  /// Returns the place of `name` in this map.
  /// @throw Failure(bad_usage) when the value of this place is given and is no map.
  [[nodiscard]] Place child(std::string_view name) const;
  [[nodiscard]] base::Failure complaint(const std::string& problem) const {
    return scenario.complaint(path, problem);
  }
};

/// Error of an invalid value, with the value's text. The text is made only when it is needed: a
/// message about an entry of a list shows the list, which may be long.
struct InvalidValue {
  std::string value;
};

/// A value as it is written, and its allowed numbers.
struct Written {
  const YamlNode& node;
  const base::Range& range;  ///< range of each number in the value
  int num_joints;
};

/// Read a value.
/// @throw InvalidValue if the value has another type or is outside `written.range`
void read_value(const Written& written, std::string& to);
void read_value(const Written& written, bool& to);
void read_value(const Written& written, double& to);
void read_value(const Written& written, std::int64_t& to);
void read_value(const Written& written, Vector& to);
void read_value(const Written& written, std::vector<double>& to);
/// Reads a vector of joints, or a matrix as a list per joint, which becomes one vector, row by row.
void read_vector_or_matrix(const Written& written, Vector& to);
void read_value(const Written& written, std::vector<Vector>& to);
template <class Value>
requires std::is_enum_v<Value> || std::integral<Value>
void read_value(const Written& written, Value& to) {
  std::conditional_t<std::is_enum_v<Value>, std::string, std::int64_t> value;
  read_value(written, value);
  if constexpr (std::is_enum_v<Value>) {
    const std::optional<Value> chosen = base::value_of<Value>(value);
    if (!chosen) throw InvalidValue{value};
    to = *chosen;
  } else {
    to = static_cast<Value>(value);
  }
}

/// Refuses unknown keys of the map at `place`, if one is given.
/// @throw Failure(bad_usage) when a key is not among `names`. The message names its right section,
/// the nearest key, or all keys.
void require_known(const Place& place, const std::vector<std::string_view>& names);

/// Refuses the keys that `Struct` does not declare.
template <class Struct>
void require_known_keys(const Place& place) {
  std::vector<std::string_view> names;
  base::for_each_key<Struct>([&](const auto& key) { names.push_back(key.name); });
  require_known(place, names);
}

/// Returns the only one of `names` that the map at `place` has. If `first_by_name`, the first of
/// them may be given by its name alone, or not at all.
/// @throw InvalidValue if the value at `place` is no map
/// @throw Failure(bad_usage) if the map has none or several of these names
std::string_view read_alternative(const Place& place, const std::vector<std::string_view>& names,
                                  bool first_by_name);

template <class Struct>
void read(const Place& place, Struct& to);

/// Reads the value at `place` into `to`. The value may be missing only for one of several structs
/// (std::variant).
/// @throw InvalidValue when `key` does not allow the value
/// @throw Failure(bad_usage) for an error inside of the value.
template <class Key, class Value>
void read_place(const Place& place, const Key& key, Value& to) {
  read_value({*place.node, key.range, place.scenario.num_joints}, to);
}

/// Reads a map whose keys are names of the user's choice.
template <class Key, class Entry>
void read_place(const Place& place, const Key& key, std::map<std::string, Entry>& to) {
  if (place.node->kind != YamlNode::Kind::map) throw InvalidValue{emit_line(*place.node)};
  for (const std::string& name : place.node->keys) {
    const Place entry = place.child(name);
    try {
      if constexpr (std::is_same_v<Entry, Vector>) {
        read_vector_or_matrix({*entry.node, key.range, place.scenario.num_joints}, to[name]);
      } else {
        read_place(entry, key, to[name]);
      }
    } catch (const InvalidValue& refused) {
      throw entry.complaint(refused.value +
                            "; allowed: " + base::allowed_text(base::shape_of<Entry>, key.range));
    }
  }
}

/// Reads a list of maps.
template <class Key, class Struct>
requires base::has_keys<Struct>
void read_place(const Place& place, const Key& /*key*/, std::vector<Struct>& to) {
  const YamlNode& list = *place.node;
  if (list.kind != YamlNode::Kind::list || list.children.empty())
    throw InvalidValue{emit_line(list)};
  for (const YamlNode& entry : list.children) {
    const std::string index = "[" + std::to_string(to.size()) + "]";
    read(Place{place.scenario, &entry, place.path + index}, to.emplace_back());
  }
}

/// Reads one of several structs: a map with the name of one, or the name of the first alone if it
/// is the default.
template <class Key, class... T>
void read_place(const Place& place, const Key& key, std::variant<T...>& to) {
  const std::string_view chosen =
      read_alternative(place, {T::name...}, key.fallback == base::Default::of_struct);
  const bool map = place.node != nullptr && place.node->kind == YamlNode::Kind::map;
  const Place inside = map ? place.child(chosen) : Place{place.scenario, nullptr, place.path};
  const auto read_if_chosen = [&]<class Alternative>(Alternative made) {
    if (Alternative::name != chosen) return;
    read(inside, made);
    to = std::move(made);
  };
  (read_if_chosen(T{}), ...);
}

/// Fills the member of `key` from `place` or with its default.
/// @throw Failure(bad_usage), one line: where, key, value, what is allowed.
template <class Struct, class Member>
void read_key(const Place& place, const base::Key<Struct, Member>& key,
              std::type_identity_t<Struct>& to) {
  constexpr base::Shape shape = base::shape_of<Member>;
  if constexpr (shape == base::Shape::map) {
    read(place, to.*key.member);
  } else {
    if (shape != base::Shape::one_of && place.node == nullptr) {
      if (key.fallback == base::Default::required) {
        throw place.complaint("missing; allowed: " + base::allowed_text(key));
      }
      if constexpr (std::is_same_v<Member, Vector>) {
        to.*key.member = Vector::Constant(place.scenario.num_joints, key.each_joint);
      }
      return;
    }
    if constexpr (std::is_assignable_v<Member&, std::nullopt_t>) {
      if (key.nullable && place.node->kind == YamlNode::Kind::null) {
        to.*key.member = std::nullopt;
        return;
      }
    }
    typename base::ValueOf<Member>::Type value{};
    try {
      read_place(place, key, value);
    } catch (const InvalidValue& refused) {
      throw place.complaint(refused.value + "; allowed: " + base::allowed_text(key));
    }
    if constexpr (std::is_function_v<Member>) {
      (to.*key.member)(std::move(value));
    } else {
      to.*key.member = std::move(value);
    }
  }
}

/// Fills all members of `to` that have keys, and checks the rules of `to.refusal()`.
/// @throw Failure(bad_usage) as `read_key`.
template <class Struct>
void read(const Place& place, Struct& to) {
  require_known_keys<Struct>(place);
  base::for_each_key<Struct>([&](const auto& key) { read_key(place.child(key.name), key, to); });
  if constexpr (requires { to.refusal(); }) {
    if (const std::optional<base::Refusal> refused = to.refusal()) {
      const std::string path = (place.path.empty() ? "" : place.path + ".") + refused->key;
      throw place.scenario.complaint(path, refused->problem);
    }
  }
}

}  // namespace tachless::scenario
