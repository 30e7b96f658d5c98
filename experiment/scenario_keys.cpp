#include "experiment/scenario_keys.h"

#include <fmt/format.h>

#include <set>

#include "diagnostics/text.h"
#include "experiment/scenario.h"

namespace tachless::experiment {
namespace {

template <class T>
std::string text_of(const T& value) {
  if constexpr (schema::shape_of<T> == schema::Shape::choice) {
    return std::string(schema::name_of(value));
  } else {
    return fmt::format("{}", value);
  }
}
template <class T>
std::string text_of(const std::optional<T>& value) {
  return value ? text_of(*value) : "null";
}
template <class... T>
std::string text_of(const std::variant<T...>& value) {
  return std::visit([](const auto& alternative) { return std::string(alternative.name); }, value);
}

/// What the documentation says stands in for the value of `key`.
template <class Struct, class Member>
std::string fallback_text(const schema::Key<Struct, Member>& key) {
  switch (key.fallback) {
    case schema::Default::required:
      return "**required**";
    case schema::Default::described:
      return std::string(key.described_default);
    case schema::Default::of_joints:
      return fmt::format("`{}`", key.each_joint);
    case schema::Default::of_struct:
      break;
  }
  using Value = typename schema::ValueOf<Member>::Type;
  if constexpr (std::is_function_v<Member>) {
    return fmt::format("`{}`", text_of(Value{}));
  } else if constexpr (fmt::is_formattable<Value>::value || std::is_enum_v<Value>) {
    return fmt::format("`{}`", text_of(Struct{}.*key.member));
  } else {
    return "";
  }
}

using Rows = std::vector<ScenarioKey>;

template <class Struct>
void add_keys(const std::string& prefix, Rows& rows);

template <class... T>
void add_alternatives(const std::string& path, Rows& rows, const std::variant<T...>* /*type*/) {
  const auto add = [&]<class Alternative>(const Alternative* /*type*/) {
    const std::string name = fmt::format("{}.{}", path, Alternative::name);
    rows.push_back({name, "", "", "", ""});
    add_keys<Alternative>(name + ".", rows);
  };
  (add(static_cast<const T*>(nullptr)), ...);
}

/// The rows of all keys of `Struct` and of what lies below them.
template <class Struct>
void add_keys(const std::string& prefix, Rows& rows) {
  schema::for_each_key<Struct>([&]<class Owner, class Member>(
                                   const schema::Key<Owner, Member>& key) {
    using Value = typename schema::ValueOf<Member>::Type;
    constexpr schema::Shape shape = schema::shape_of<Member>;
    const std::string path = prefix + std::string(key.name);
    if constexpr (schema::has_names_of_choice<Value>) {
      const schema::Key<Value, typename Value::mapped_type> each("<name>", nullptr);
      rows.push_back({path, "", "", "", ""});
      rows.push_back({path + ".<name>", key.unit, fallback_text(key),
                      schema::allowed_text(each.in(key.range)), key.meaning});
    } else if constexpr (shape == schema::Shape::map) {
      rows.push_back({path, "", "", "", ""});
      add_keys<Value>(path + ".", rows);
    } else {
      rows.push_back({path, key.unit, fallback_text(key), schema::allowed_text(key), key.meaning});
    }
    if constexpr (shape == schema::Shape::one_of) {
      add_alternatives(path, rows, static_cast<const Value*>(nullptr));
    }
    if constexpr (shape == schema::Shape::list_of_maps) {
      add_keys<typename Value::value_type>(path + ".", rows);
    }
  });
}

std::string without_indices(std::string_view path) {
  std::string plain;
  bool inside = false;
  for (const char c : path) {
    if (c == '[') inside = true;
    if (!inside) plain += c;
    if (c == ']') inside = false;
  }
  return plain;
}

std::string_view parent(std::string_view path) {
  const std::size_t dot = path.rfind('.');
  return dot == std::string_view::npos ? std::string_view{} : path.substr(0, dot);
}

std::string_view last_name(std::string_view path) { return path.substr(path.rfind('.') + 1); }

/// All paths, for look-up; and those that have others below.
struct Paths {
  std::set<std::string, std::less<>> all, with_keys_below;

  Paths() {
    for (const ScenarioKey& key : scenario_keys()) {
      all.insert(key.path);
      with_keys_below.emplace(parent(key.path));
    }
  }
};

const Paths& paths() {
  static const Paths made;
  return made;
}

}  // namespace

const std::vector<ScenarioKey>& scenario_keys() {
  static const Rows rows = [] {
    Rows made;
    add_keys<Scenario>("", made);
    return made;
  }();
  return rows;
}

bool is_scenario_key(std::string_view path) {
  const std::string plain = without_indices(path);
  return paths().all.count(plain) != 0 ||
         paths().all.count(fmt::format("{}.<name>", parent(plain))) != 0;
}

bool has_keys_below(std::string_view path) {
  return paths().with_keys_below.count(without_indices(path)) != 0;
}

std::string known_keys_hint(std::string_view path, const std::vector<std::string>& gains) {
  const std::string plain = without_indices(path);
  // A misspelt name in its right map is likelier than a right name in a wrong map.
  std::vector<std::string_view> siblings;
  std::vector<std::string> elsewhere;
  for (const ScenarioKey& key : scenario_keys()) {
    if (last_name(key.path) == "<name>") continue;
    if (parent(key.path) == parent(plain)) siblings.push_back(last_name(key.path));
    if (!plain.starts_with(key.path + ".")) elsewhere.push_back(key.path);
  }
  for (const std::string& gain : gains) elsewhere.push_back("controller.gains." + gain);
  const std::string prefix = parent(plain).empty() ? "" : fmt::format("{}.", parent(plain));
  if (const auto near = diagnostics::nearest(last_name(plain), siblings)) {
    return fmt::format("nearest known key is {}{}", prefix, *near);
  }
  if (const auto near = diagnostics::nearest(last_name(plain), elsewhere)) {
    return "nearest known key is " + *near;
  }
  return fmt::format("known keys {}: {}",
                     prefix.empty() ? "of a scenario" : fmt::format("of {}", parent(plain)),
                     diagnostics::joined(siblings));
}

std::string scenario_key_table() {
  std::string table =
      "| key | unit | default | allowed | meaning |\n"
      "|---|---|---|---|---|\n";
  for (const ScenarioKey& key : scenario_keys()) {
    if (key.meaning.empty()) continue;
    table += fmt::format("| `{}` | {} | {} | {} | {} |\n", key.path, key.unit, key.fallback,
                         key.allowed, key.meaning);
  }
  return table;
}

}  // namespace tachless::experiment
