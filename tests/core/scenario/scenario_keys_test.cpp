#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <optional>
#include <sstream>
#include <string>
#include <type_traits>
#include <variant>

#include "base/schema.h"
#include "scenario/key_paths.h"
#include "scenario/scenario.h"

namespace tachless::scenario {
namespace {

using ::testing::HasSubstr;

template <class T>
std::string text_of(const T& value) {
  if constexpr (base::shape_of<T> == base::Shape::choice) {
    return std::string(base::name_of(value));
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

/// Returns the documentation's text for the default of `key`.
template <class Struct, class Member>
std::string fallback_text(const base::Key<Struct, Member>& key) {
  switch (key.fallback) {
    case base::Default::required:
      return "**required**";
    case base::Default::described:
      return std::string(key.described_default);
    case base::Default::of_joints:
      return fmt::format("`{}`", key.each_joint);
    case base::Default::of_struct:
      break;
  }
  using Value = typename base::ValueOf<Member>::Type;
  if constexpr (std::is_function_v<Member>) {
    return fmt::format("`{}`", text_of(Value{}));
  } else if constexpr (fmt::is_formattable<Value>::value || std::is_enum_v<Value>) {
    return fmt::format("`{}`", text_of(Struct{}.*key.member));
  } else {
    return "";
  }
}

/// Returns the table of docs/scenario.md, in Markdown.
std::string scenario_key_table() {
  std::string table =
      "| key | unit | default | allowed | meaning |\n"
      "|---|---|---|---|---|\n";
  const auto add_row = [&]<class Owner, class Member>(const std::string& path,
                                                      const base::Key<Owner, Member>& key) {
    std::string allowed = base::allowed_text(key);
    if constexpr (has_names_of_choice<Member>) {
      using Entry = typename Member::mapped_type;
      allowed = base::allowed_text(base::shape_of<Entry>, key.range);
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
}  // namespace tachless::scenario
