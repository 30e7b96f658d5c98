#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

#include "experiment/scenario.h"
#include "experiment/yaml_tree.h"
#include "schema/schema.h"

/// From a tree of YAML to any struct with keys (schema/schema.h). Does not look for keys that are
/// not declared (scenario_keys.h does) and knows no rule between structs (scenario.cpp).
namespace tachless::experiment {

/// A value, or the lack of it, and where it stands in the scenario.
struct Place {
  const Scenario& scenario;  ///< for lines, and for the number of joints
  const YamlNode* node;      ///< null: not given
  std::string path;          ///< "loop.period_s"; empty for the whole scenario

  /// The value of `name` in this map. @throw Failure(bad_usage) when this is given and no map.
  [[nodiscard]] Place child(std::string_view name) const;
  [[nodiscard]] diagnostics::Failure complaint(const std::string& problem) const {
    return scenario.complaint(path, problem);
  }
};

/// A value that is not what it must be: its text, for the message. Made only when it is needed: a
/// message about an entry of a list shows the list, which may be long.
struct Refused {
  std::string value;
};

/// @throw Refused.
std::string read_text(const YamlNode& node);
double read_number(const YamlNode& node, const schema::Range& range);
std::int64_t read_whole(const YamlNode& node, const schema::Range& range);
bool read_yes_no(const YamlNode& node);
std::vector<double> read_numbers(const YamlNode& node, const schema::Range& range);
robot::Vector read_joints(const YamlNode& node, const schema::Range& range, int num_joints);
std::vector<robot::Vector> read_joints_list(const YamlNode& node, const schema::Range& range,
                                            int num_joints);

/// The only one of `names` that the map at `place` has.
/// @throw Failure(bad_usage) when it has none of them or several.
std::string_view only_one(const Place& place, const std::vector<std::string_view>& names);

template <class Struct>
void read(const Place& place, Struct& to);

/// One of several structs: a map with the name of one, or the name alone if `first_by_name`, which
/// is then what stands in when nothing is given.
template <class... T>
void read_one_of(const Place& place, bool first_by_name, std::variant<T...>& to) {
  const std::vector<std::string_view> names = {T::name...};
  const YamlNode* const node = place.node;
  const bool named =
      first_by_name &&
      (node == nullptr || (node->kind == YamlNode::Kind::scalar && node->scalar == names.front()));
  if (!named && node != nullptr && node->kind != YamlNode::Kind::map) {
    throw Refused{emit_line(*node)};
  }
  const std::string_view chosen = named ? names.front() : only_one(place, names);
  const Place inside = named ? Place{place.scenario, nullptr, place.path} : place.child(chosen);
  const auto read_if_chosen = [&]<class Alternative>(Alternative made) {
    if (Alternative::name != chosen) return;
    read(inside, made);
    to = std::move(made);
  };
  (read_if_chosen(T{}), ...);
}

/// The value of type `Value` at `place`, which has one (but for maps and alternatives).
/// @throw Refused when it is not what `key` allows, Failure(bad_usage) for what is inside of it.
template <class Value, class Key>
Value read_value(const Place& place, const Key& key) {
  constexpr schema::Shape shape = schema::shape_of<Value>;
  Value value{};
  if constexpr (shape == schema::Shape::text) {
    value = read_text(*place.node);
  } else if constexpr (shape == schema::Shape::choice) {
    const std::string name = read_text(*place.node);
    const std::optional<Value> chosen = schema::value_of<Value>(name);
    if (!chosen) throw Refused{name};
    value = *chosen;
  } else if constexpr (shape == schema::Shape::yes_no) {
    value = read_yes_no(*place.node);
  } else if constexpr (shape == schema::Shape::number) {
    value = read_number(*place.node, key.range);
  } else if constexpr (shape == schema::Shape::whole) {
    value = static_cast<Value>(read_whole(*place.node, key.range));
  } else if constexpr (shape == schema::Shape::joints) {
    value = read_joints(*place.node, key.range, place.scenario.num_joints);
  } else if constexpr (shape == schema::Shape::numbers) {
    value = read_numbers(*place.node, key.range);
  } else if constexpr (shape == schema::Shape::joints_list) {
    value = read_joints_list(*place.node, key.range, place.scenario.num_joints);
  } else if constexpr (schema::has_names_of_choice<Value>) {
    if (place.node->kind != YamlNode::Kind::map) throw Refused{emit_line(*place.node)};
    for (const std::string& name : place.node->keys) {
      const Place entry = place.child(name);
      using Entry = typename Value::mapped_type;
      const schema::Key<Value, Entry> each(name, nullptr);
      try {
        value[name] = read_value<Entry>(entry, each.in(key.range));
      } catch (const Refused& refused) {
        throw entry.complaint(refused.value +
                              "; allowed: " + schema::allowed_text(each.in(key.range)));
      }
    }
  } else if constexpr (shape == schema::Shape::list_of_maps) {
    const YamlNode& list = *place.node;
    if (list.kind != YamlNode::Kind::list || list.children.empty()) throw Refused{emit_line(list)};
    for (const YamlNode& entry : list.children) {
      const std::string index = "[" + std::to_string(value.size()) + "]";
      read(Place{place.scenario, &entry, place.path + index}, value.emplace_back());
    }
  } else if constexpr (shape == schema::Shape::one_of) {
    read_one_of(place, key.fallback == schema::Default::of_struct, value);
  } else {
    read(place, value);
  }
  return value;
}

/// Fills the member of `key`, from `place` or with its default.
/// @throw Failure(bad_usage), one line: where, key, value, what is allowed.
template <class Struct, class Member>
void read_key(const Place& place, const schema::Key<Struct, Member>& key, Struct& to) {
  using Value = typename schema::ValueOf<Member>::Type;
  constexpr schema::Shape shape = schema::shape_of<Member>;
  if constexpr (shape == schema::Shape::map) {
    read(place, to.*key.member);
    return;
  } else if constexpr (shape != schema::Shape::one_of) {
    if (place.node == nullptr) {
      if (key.fallback == schema::Default::required) {
        throw place.complaint("missing; allowed: " + schema::allowed_text(key));
      }
      if constexpr (std::is_same_v<Member, robot::Vector>) {
        to.*key.member = robot::Vector::Constant(place.scenario.num_joints, key.each_joint);
      }
      return;
    }
    if constexpr (std::is_assignable_v<Member&, std::nullopt_t>) {
      if (key.nullable && place.node->kind == YamlNode::Kind::null) {
        to.*key.member = std::nullopt;
        return;
      }
    }
  }
  try {
    if constexpr (std::is_function_v<Member>) {
      (to.*key.member)(read_value<Value>(place, key));
    } else {
      to.*key.member = read_value<Value>(place, key);
    }
  } catch (const Refused& refused) {
    throw place.complaint(refused.value + "; allowed: " + schema::allowed_text(key));
  }
}

/// Fills all members of `to` that have keys, and asks it for rules that it breaks.
/// @throw Failure(bad_usage) as `read_key`.
template <class Struct>
void read(const Place& place, Struct& to) {
  schema::for_each_key<Struct>(
      [&](const auto& key) { read_key(place.child(key.name), key, static_cast<Struct&>(to)); });
  if constexpr (requires { to.refusal(); }) {
    if (const std::optional<schema::Refusal> refused = to.refusal()) {
      const std::string path = (place.path.empty() ? "" : place.path + ".") + refused->key;
      throw place.scenario.complaint(path, refused->problem);
    }
  }
}

}  // namespace tachless::experiment
