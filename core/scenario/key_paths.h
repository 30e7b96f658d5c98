#pragma once

#include <string>
#include <type_traits>
#include <variant>

#include "base/schema.h"

/// Paths of the keys that a struct declares (core/base/schema.h), such as "loop.period_s".
namespace tachless::scenario {

/// True for a value whose entries stand under names of the user's choice.
template <class T>
constexpr bool has_names_of_choice = base::shape_of<T> == base::Shape::named_joints ||
                                     base::shape_of<T> == base::Shape::named_numbers ||
                                     base::shape_of<T> == base::Shape::named_texts;

/// Calls `visit(path, key)` for each key of `Struct` and for each key below. Calls `visit(path)`
/// for a map. Entries of a list have no index; "<name>" stands for the user's choice.
template <class Struct, class Visit>
void for_each_path(const std::string& prefix, const Visit& visit) {
  base::for_each_key<Struct>([&]<class Owner, class Member>(const base::Key<Owner, Member>& key) {
    using Value = typename base::ValueOf<Member>::Type;
    constexpr base::Shape shape = base::shape_of<Member>;
    const std::string path = prefix + std::string(key.name);
    if constexpr (has_names_of_choice<Value>) {
      visit(path);
      visit(path + ".<name>", key);
    } else if constexpr (shape == base::Shape::map) {
      visit(path);
      for_each_path<Value>(path + ".", visit);
    } else {
      visit(path, key);
    }
    if constexpr (shape == base::Shape::one_of) {
      const auto add = [&]<class Alternative>(const Alternative* /*type*/) {
        const std::string name = path + "." + std::string(Alternative::name);
        visit(name);
        for_each_path<Alternative>(name + ".", visit);
      };
      [&]<class... T>(const std::variant<T...>* /*type*/) {
        (add(static_cast<const T*>(nullptr)), ...);
      }(static_cast<const Value*>(nullptr));
    }
    if constexpr (shape == base::Shape::list_of_maps) {
      for_each_path<typename Value::value_type>(path + ".", visit);
    }
  });
}

}  // namespace tachless::scenario
