#include "scenario/reader.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace tachless::scenario {
namespace {

/// Settings that a law might have: values of every simple shape.
struct Tuning {
  Vector kp, ki;
  double cutoff_hz = 50;
  int order = 2;
  bool raw = false;
  std::optional<double> limit;

  [[nodiscard]] std::optional<base::Refusal> refusal() const {
    if (!raw || order == 2) return std::nullopt;
    return base::Refusal{"order", std::to_string(order) + "; allowed: only without raw"};
  }

  static constexpr std::tuple keys{
      base::Key{"kp", &Tuning::kp, "N m/rad", "Stiffness"}.in(base::positive),
      base::Key{"ki", &Tuning::ki, "", "Integral"}.in(base::not_negative).by_default(0.5),
      base::Key{"cutoff_hz", &Tuning::cutoff_hz, "Hz", "Cut-off"}.in({1, 100}).by_default(),
      base::Key{"order", &Tuning::order, "", "Of the filter"}.in({1, 4}).by_default(),
      base::Key{"raw", &Tuning::raw, "", "Without filter"}.by_default(),
      base::Key{"limit", &Tuning::limit, "N m", "Largest"}.by_default("none").or_null()};
};

Tuning tuning(const std::string& yaml) {
  Scenario scenario;
  scenario.source = "f.yaml";
  scenario.num_joints = 2;
  const YamlNode root = parse_yaml(yaml, scenario.source);
  Tuning to;
  read(Place{scenario, &root, "tuning"}, to);
  return to;
}

std::string refusal_of_tuning(const std::string& yaml) {
  try {
    (void)tuning(yaml);
  } catch (const base::Failure& failure) {
    return failure.what();
  }
  return "accepted";
}

TEST(Reader, FillsAStructByItsKeys) {
  const Tuning given = tuning("{kp: [1, 2], ki: 3, cutoff_hz: 20, order: 4, raw: false, limit: 7}");
  EXPECT_EQ(given.kp, Vector(Eigen::Vector2d(1, 2)));
  EXPECT_EQ(given.ki, Vector(Eigen::Vector2d(3, 3)));
  EXPECT_EQ(given.cutoff_hz, 20);
  EXPECT_EQ(given.order, 4);
  EXPECT_FALSE(given.raw);
  EXPECT_EQ(given.limit, 7);
}

TEST(Reader, GivesDefaultsToWhatIsLeftOut) {
  const Tuning by_default = tuning("{kp: 1, limit: null}");
  EXPECT_EQ(by_default.ki, Vector(Eigen::Vector2d(0.5, 0.5)));
  EXPECT_EQ(by_default.cutoff_hz, 50);
  EXPECT_EQ(by_default.order, 2);
  EXPECT_EQ(by_default.limit, std::nullopt);
}

TEST(Reader, RefusesWithKeyValueAndWhatIsAllowed) {
  EXPECT_EQ(refusal_of_tuning("{}"),
            "f.yaml: tuning.kp: missing; allowed: a finite number, or a list with one per joint, "
            "each > 0");
  EXPECT_EQ(refusal_of_tuning("{kp: [1, 0]}"),
            "f.yaml: tuning.kp: entry 2 of [1, 0] is 0; allowed: a finite number, or a list with "
            "one per joint, each > 0");
  EXPECT_EQ(refusal_of_tuning("{kp: 1, order: 2.5}"),
            "f.yaml: tuning.order: 2.5; allowed: a whole number in [1, 4]");
  EXPECT_EQ(refusal_of_tuning("{kp: 1, raw: yes}"),
            "f.yaml: tuning.raw: yes; allowed: true or false");
  EXPECT_EQ(refusal_of_tuning("{kp: 1, cutoff_hz: null}"),
            "f.yaml: tuning.cutoff_hz: null; allowed: a finite number in [1, 100]");
  EXPECT_EQ(refusal_of_tuning("{kp: 1, raw: true, order: 3}"),
            "f.yaml: tuning.order: 3; allowed: only without raw");
  EXPECT_EQ(refusal_of_tuning("{kp: 1, kpp: 2}"),
            "f.yaml: tuning.kpp: unknown; nearest known key is tuning.kp");
  EXPECT_EQ(
      refusal_of_tuning("{quux: 1}"),
      "f.yaml: tuning.quux: unknown; known keys of tuning: kp, ki, cutoff_hz, order, raw, limit");
  EXPECT_EQ(refusal_of_tuning("[1]"), "f.yaml: tuning: [1]; allowed: a map");
}

}  // namespace
}  // namespace tachless::scenario
