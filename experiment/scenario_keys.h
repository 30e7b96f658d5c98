#pragma once

#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "schema/schema.h"

/// Which keys a scenario has, from the declarations beside the specs. Does not read values
/// (reader.h).
namespace tachless::experiment {

/// Calls `visit(path, key)` for each key of `Struct` and for each below, and `visit(path)` for what
/// only has others below. Entries of a list go without index; "<name>" stands for the user's
/// choice.
template <class Struct, class Visit>
void for_each_path(const std::string& prefix, const Visit& visit) {
  schema::for_each_key<Struct>(
      [&]<class Owner, class Member>(const schema::Key<Owner, Member>& key) {
        using Value = typename schema::ValueOf<Member>::Type;
        constexpr schema::Shape shape = schema::shape_of<Member>;
        const std::string path = prefix + std::string(key.name);
        if constexpr (schema::has_names_of_choice<Value>) {
          visit(path);
          visit(path + ".<name>", key);
        } else if constexpr (shape == schema::Shape::map) {
          visit(path);
          for_each_path<Value>(path + ".", visit);
        } else {
          visit(path, key);
        }
        if constexpr (shape == schema::Shape::one_of) {
          const auto add = [&]<class Alternative>(const Alternative* /*type*/) {
            const std::string name = path + "." + std::string(Alternative::name);
            visit(name);
            for_each_path<Alternative>(name + ".", visit);
          };
          [&]<class... T>(const std::variant<T...>* /*type*/) {
            (add(static_cast<const T*>(nullptr)), ...);
          }(static_cast<const Value*>(nullptr));
        }
        if constexpr (shape == schema::Shape::list_of_maps) {
          for_each_path<typename Value::value_type>(path + ".", visit);
        }
      });
}

/// True for a declared key. `path` may have indices: "reference.multi_sine.terms[2].phase_rad".
bool is_scenario_key(std::string_view path);

/// True when other keys lie below: the value is a map or a list of maps.
bool has_keys_below(std::string_view path);

/// "nearest known key is loop.period_s" for the unknown `path`, or else the keys of its map.
/// `gains` are names in controller.gains, which are not declared.
std::string known_keys_hint(std::string_view path, const std::vector<std::string>& gains = {});

}  // namespace tachless::experiment
