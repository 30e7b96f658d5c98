#include "experiment/scenario_keys.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <optional>
#include <sstream>
#include <string>
#include <type_traits>
#include <variant>

#include "experiment/scenario.h"

namespace tachless::experiment {
namespace {

using ::testing::HasSubstr;

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
    if constexpr (schema::has_names_of_choice<Member>) {
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

TEST(ScenarioKeys, AreKnownWithTheirMapsAndTheGainsOfTheUsersChoice) {
  for (const char* path : {"name", "plant.initial", "loop.period_s", "controller.gains.anything",
                           "robot.joints.flexible", "reference.multi_sine.terms[3].phase_rad"}) {
    EXPECT_TRUE(is_scenario_key(path)) << path;
  }
  for (const char* path :
       {"", "loop.period", "controller.gains.kp.x", "plant.<name>", "loop.name"}) {
    EXPECT_FALSE(is_scenario_key(path)) << path;
  }
  EXPECT_TRUE(has_keys_below("reference.multi_sine.terms[0]"));
  EXPECT_TRUE(has_keys_below("controller.gains"));
  EXPECT_FALSE(has_keys_below("reference.waypoints.position_rad"));
}

TEST(ScenarioKeys, TheNearestOneIsFoundUnderItsOwnMapFirst) {
  const auto nearest = [](const std::string& path) {
    const std::string hint = known_keys_hint(path, {"kp", "kd"});
    const std::string before = "nearest known key is ";
    return hint.rfind(before, 0) == 0 ? hint.substr(before.size()) : hint;
  };
  EXPECT_EQ(nearest("loop.perod_s"), "loop.period_s");
  EXPECT_EQ(nearest("reference.hold.position"), "reference.hold.position_rad");
  EXPECT_EQ(nearest("plant.initial.position"), "plant.initial.position_rad");
  EXPECT_EQ(nearest("stiffness_Nm_per_rad"), "robot.joints.flexible.stiffness_Nm_per_rad");
  EXPECT_EQ(nearest("contoller"), "controller");
  EXPECT_EQ(nearest("kp"), "controller.gains.kp");
  EXPECT_EQ(nearest("controller.kd"), "controller.gains.kd");
  EXPECT_EQ(nearest("plant.period_s"), "loop.period_s");
}

TEST(ScenarioKeys, AreListedWhenNoneIsNear) {
  EXPECT_EQ(known_keys_hint("robot.joints.flexible.backlash"),
            "known keys of robot.joints.flexible: stiffness_Nm_per_rad, rotor_inertia_kgm2, "
            "motor_damping_Nms_per_rad");
  EXPECT_EQ(known_keys_hint("quux"),
            "known keys of a scenario: name, robot, plant, reference, controller, loop");
}

}  // namespace
}  // namespace tachless::experiment
