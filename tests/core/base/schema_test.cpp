#include "base/schema.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace tachless::base::testing {

enum class Side { motor, link };
constexpr std::array<std::string_view, 2> names(Side /*type*/) { return {"motor", "link"}; }

struct Plain {
  double x = 2;
  static constexpr std::string_view name = "plain";
  static constexpr std::tuple keys{Key{"x", &Plain::x, "m", "A place"}.by_default()};
};
struct Other : Plain {
  static constexpr std::string_view name = "other";
};

struct Gains {
  Vector kp, ki;
  double cutoff_hz = 50;
  int order = 2;
  bool raw = false;
  Side side = Side::motor;
  std::optional<double> limit;
  std::optional<std::variant<Plain, Other>> kind;
  std::vector<Plain> places;

  void set_kind(std::variant<Plain, Other> given) { kind = given; }

  static constexpr std::tuple keys{
      Key{"kp", &Gains::kp, "N m/rad", "Proportional gain"}.in(positive),
      Key{"ki", &Gains::ki, "N m/(rad s)", "Integral gain"}.in(not_negative).by_default(0),
      Key{"cutoff_hz", &Gains::cutoff_hz, "Hz", "Cut-off"}.in({0, 100, true, false}).by_default(),
      Key{"order", &Gains::order, "", "Of the filter"}.in({1, 4}).by_default(),
      Key{"raw", &Gains::raw, "", "Without filter"}.by_default(),
      Key{"side", &Gains::side, "", "Where"}.by_default(),
      Key{"limit", &Gains::limit, "N m", "Largest"}.by_default("none").or_null(),
      Key{"kind", &Gains::set_kind, "", "What"},
      Key{"places", &Gains::places, "", "Where"}};
};

namespace {

using ::testing::ElementsAre;

TEST(Range, IsWrittenAsAnInterval) {
  EXPECT_EQ((Range{0, 1, true, false}).text(), "in (0, 1]");
  EXPECT_EQ((Range{0, 9007199254740992.0}).text(), "in [0, 9007199254740992]");
  EXPECT_EQ((Range{1e-14, 0.1}).text(), "in [1e-14, 0.1]");
  EXPECT_EQ(positive.text(), "> 0");
  EXPECT_EQ(not_negative.text(), ">= 0");
  EXPECT_EQ(Range{}.text(), "");
}

TEST(Range, HoldsFiniteNumbersBetweenItsEnds) {
  EXPECT_FALSE((Range{0, 1, true, false}).contains(0));
  EXPECT_TRUE((Range{0, 1, true, false}).contains(1));
  EXPECT_FALSE((Range{0, 1, false, true}).contains(1));
  EXPECT_TRUE(not_negative.contains(0));
  EXPECT_FALSE(Range{}.contains(std::numeric_limits<double>::infinity()));
  EXPECT_FALSE(Range{}.contains(-std::numeric_limits<double>::infinity()));
  EXPECT_FALSE(Range{}.contains(std::numeric_limits<double>::quiet_NaN()));
}

TEST(Names, GoBothWaysAndDoNotDependOnTheOrderOfTheEnum) {
  EXPECT_EQ(name_of(Side::link), "link");
  EXPECT_EQ(value_of<Side>("motor"), Side::motor);
  EXPECT_EQ(value_of<Side>("Motor"), std::nullopt);
}

TEST(Keys, SayWhatMayBeWrittenFromTheMembersTypeAndTheRange) {
  std::vector<std::string> allowed;
  for_each_key<Gains>([&](const auto& key) { allowed.push_back(allowed_text(key)); });
  EXPECT_THAT(
      allowed,
      ElementsAre("a finite number, or a list with one per joint, each > 0",
                  "a finite number, or a list with one per joint, each >= 0",
                  "a finite number in (0, 100]", "a whole number in [1, 4]", "true or false",
                  "one of motor, link", "a finite number; or null",
                  "a map with exactly one of plain, other", "a list of maps, at least one"));
}

TEST(Keys, PointToTheMembersTheyFill) {
  Gains gains;
  gains.*std::get<0>(Gains::keys).member = Vector::Ones(2);
  EXPECT_EQ(gains.kp, Vector(Vector::Ones(2)));
  (gains.*std::get<7>(Gains::keys).member)(Other{});
  EXPECT_TRUE(std::holds_alternative<Other>(gains.kind.value()));
}

TEST(Keys, KnowTheirDefaults) {
  std::vector<Default> fallbacks;
  for_each_key<Gains>([&](const auto& key) { fallbacks.push_back(key.fallback); });
  EXPECT_THAT(fallbacks, ElementsAre(Default::required, Default::of_joints, Default::of_struct,
                                     Default::of_struct, Default::of_struct, Default::of_struct,
                                     Default::described, Default::required, Default::required));
}

}  // namespace
}  // namespace tachless::base::testing
