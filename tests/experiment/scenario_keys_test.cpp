#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <optional>
#include <sstream>
#include <string>
#include <type_traits>
#include <variant>

#include "experiment/scenario.h"
#include "schema/schema.h"

namespace tachless::experiment {
namespace {

using ::testing::HasSubstr;

/// Whether its entries stand under names of the user's choice.
template <class T>
constexpr bool has_names_of_choice = schema::shape_of<T> == schema::Shape::named_joints ||
                                     schema::shape_of<T> == schema::Shape::named_numbers ||
                                     schema::shape_of<T> == schema::Shape::named_texts;

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
        if constexpr (has_names_of_choice<Value>) {
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

/// The table of docs/scenario.md, in Markdown.
std::string scenario_key_table() {
  std::string table =
      "| key | unit | default | allowed | meaning |\n"
      "|---|---|---|---|---|\n";
  const auto add_row = [&]<class Owner, class Member>(const std::string& path,
                                                      const schema::Key<Owner, Member>& key) {
    std::string allowed = schema::allowed_text(key);
    if constexpr (has_names_of_choice<Member>) {
      using Entry = typename Member::mapped_type;
      allowed = schema::allowed_text(schema::Key<Member, Entry>("", nullptr).in(key.range));
    }
    table += fmt::format("| `{}` | {} | {} | {} | {} |\n", path, key.unit, fallback_text(key),
                         allowed, key.meaning);
  };
  for_each_path<Scenario>(
      "", [&](const std::string& path, const auto&... key) { (add_row(path, key), ...); });
  return table;
}

TEST(ScenarioKeys, AreAllInTheDocumentationWithUnitDefaultAndRange) {
  std::ifstream file(TACHLESS_SOURCE_DIR "/docs/scenario.md");
  std::stringstream page;
  page << file.rdbuf();
  EXPECT_THAT(page.str(), HasSubstr(scenario_key_table()))
      << "put this table into docs/scenario.md:\n"
      << scenario_key_table();
}

}  // namespace
}  // namespace tachless::experiment
