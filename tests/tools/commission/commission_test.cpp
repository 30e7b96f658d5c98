// Many arms with hidden conventions. The findings of commission are right or "not determined", and
// no arm moves further or faster than allowed.

#include "commission/commission.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <deque>
#include <iostream>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "base/failure.h"
#include "commission/emulated_arm.h"
#include "commission/trials.h"
#include "tests/tools/commission/hidden_arms.h"

namespace tachless::commission {
namespace {

using testing::HasSubstr;

/// Counts of statements about arms.
struct Tally {
  int arms = 0, refused = 0, right = 0, open = 0, named = 0, to_name = 0;
  std::vector<std::string> wrong;
  double farthest = 0, fastest = 0;  ///< deflection [rad; m], speed over its limit

  /// Commissions an arm and judges what is said of it.
  void add(const Hidden& arm, const std::string& what);
  [[nodiscard]] std::string text() const {
    return fmt::format(
        "{} arms, {} ended early; statements: {} right, {} wrong, {} not determined; faults named: "
        "{} of {}; moved {:.3g} rad, {:.3g} of the speed limit",
        arms, refused, right, wrong.size(), open, named, to_name, farthest, fastest);
  }

 private:
  template <class Value>
  void judge(const std::string& what, const std::optional<Value>& said, bool is_right) {
    if (!said) {
      ++open;
    } else if (is_right) {
      ++right;
    } else {
      wrong.push_back(fmt::format("{}: {}", what, *said));
    }
  }
  void judge(const Hidden& arm, const Commissioned& found, const std::string& what);
  void judge_text(const Hidden& arm, const std::string& said, const std::string& what);
};

void Tally::judge(const Hidden& arm, const Commissioned& found, const std::string& what) {
  const auto& compensates = arm.truth.robot.compensates;
  const bool moves = !arm.more.braked;
  judge(what + "adds gravity", found.adds_gravity,
        moves && found.adds_gravity == compensates.gravity);
  judge(what + "adds friction", found.adds_friction,
        moves && found.adds_friction == (compensates.friction == 1));
  judge(what + "delay", found.delay,
        moves && found.delay == arm.truth.loop.command_delay + arm.more.torque_delay +
                                    arm.truth.plant.encoder.latency_ticks);
  std::optional<int> unsent;
  if (found.unsent) unsent = static_cast<int>(*found.unsent);
  judge(what + "unsent", unsent,
        moves && found.unsent == (arm.more.zeroes ? Unsent::zeroed : Unsent::held));
  for (std::size_t j = 0; j < found.joints.size(); ++j) {
    const auto i = static_cast<Eigen::Index>(j);
    const Commissioned::Joint& joint = found.joints[j];
    const std::string whose = what + joint.name;
    const bool braked = !moves || (arm.fault == Fault::brake && arm.joint == i);
    const bool reversed = arm.fault == Fault::reversed && arm.joint == i;
    judge(whose + " turns", joint.turns,
          !braked && joint.turns == (arm.truth.robot.joint_signs[i] < 0));
    judge(whose + " answers", joint.answers, joint.answers == !braked);
    // A load has the effect of a scale, and is named beside it. Pulses tell a large scale roughly,
    // because friction and a load are not known yet.
    const double tolerance = arm.fault == Fault::hundredfold ? 0.7 : 0.15;
    const double truth = arm.more.scale[i];
    judge(whose + " scale", joint.scale,
          !braked &&
              (joint.scale < 0 ? reversed
                               : !reversed && (arm.fault == Fault::payload ||
                                               std::abs(*joint.scale / truth - 1) < tolerance)));
  }
}

void Tally::judge_text(const Hidden& arm, const std::string& said, const std::string& what) {
  const robot::JointLabels labels = robot::joint_labels(*arm.claimed.model);
  const auto says = [&](std::string_view words) { return said.find(words) != std::string::npos; };
  const auto only = [&](std::string_view words, bool is_true) {
    if (says(words) && !is_true) wrong.push_back(fmt::format("{}{}: {}", what, words, said));
  };
  bool all_silent = true;
  for (std::size_t j = 0; j < labels.effort.size(); ++j) {
    const bool silent = says(labels.joint(j) + " moves less than");
    all_silent = all_silent && silent;
  }
  only("on a spring", arm.fault == Fault::flexible);
  only("oscillates", arm.fault == Fault::flexible);
  only("moves as with", arm.fault == Fault::payload);
  only("does not explain how", arm.fault == Fault::payload || arm.fault == Fault::wall ||
                                   arm.fault == Fault::cogging || arm.fault == Fault::flexible ||
                                   arm.fault == Fault::brake);
  std::optional<bool> name;
  if (arm.fault == Fault::brakes || arm.fault == Fault::ignored) name = all_silent;
  if (arm.fault == Fault::reversed) {
    name =
        says(labels.joint(static_cast<std::size_t>(arm.joint)) + " moves against its own torque");
  }
  if (arm.fault == Fault::hundredfold) name = says("times the torque that it is sent");
  if (arm.fault == Fault::flexible) name = says("on a spring") || says("oscillates");
  to_name += name ? 1 : 0;
  named += name.value_or(false) ? 1 : 0;
  if (name == false) std::cout << "NOT NAMED " << what << said << "\n";
}

void Tally::add(const Hidden& arm, const std::string& what) {
  FaultyArm driver(arm.truth, arm.more);
  ClockedArm clocked(driver, arm.truth.loop.period_s);
  plant::RobotDriver& as_driven =
      arm.more.is_clock ? static_cast<plant::RobotDriver&>(clocked) : driver;
  ++arms;
  const bool shows = std::getenv("SHOW") != nullptr;
  std::string said;
  try {
    const Commissioned found =
        commission(arm.claimed, trials_on(as_driven), [&](std::string_view now) {
          if (shows) {
            std::cout << now << " moved " << list(driver.moved) << " fast " << list(driver.fastest)
                      << "\n";
          }
        });
    EXPECT_EQ(found.arm_is_clock, arm.more.is_clock) << what;
    judge(arm, found, what);
    said = fmt::format("{}", fmt::join(found.misfits, "; "));
    if (!found.delay) ++refused;
    if (shows) std::cout << tachless::commission::text(found, what);
  } catch (const base::Failure& failure) {
    said = failure.what();
    ++refused;
  }
  judge_text(arm, said, what);
  const Vector& limit = arm.truth.model->velocity_limit;
  double fast = 0;
  for (Eigen::Index i = 0; i < limit.size(); ++i) {
    fast = std::max(fast, driver.fastest[i] / (std::isfinite(limit[i]) ? limit[i] : 1));
  }
  fastest = std::max(fastest, fast);
  farthest = std::max(farthest, driver.moved.maxCoeff());
  if (shows || fast > 0.12 || driver.moved.maxCoeff() > 0.03) {
    std::cout << what << "moved " << list(driver.moved) << " fast " << list(driver.fastest)
              << " share " << fast << "\n  signs " << list(arm.truth.robot.joint_signs)
              << " compensates " << arm.truth.robot.compensates.text() << " delay "
              << arm.more.torque_delay << "+" << arm.truth.plant.encoder.latency_ticks << " scale "
              << list(arm.more.scale) << " joint " << arm.joint << "\n  " << said << "\n";
  }
}

/// No statement is wrong, and no arm came near a limit of its speed or far from its start.
void expect_right_and_safe(const Tally& tally) {
  EXPECT_THAT(tally.wrong, testing::IsEmpty());
  EXPECT_LT(tally.fastest, 0.12);
  EXPECT_LT(tally.farthest, 0.03);
}

/// Returns the number of an environment variable, or `other`.
int number_of(const char* name, int other) {
  const char* text = std::getenv(name);
  return text == nullptr ? other : std::atoi(text);
}

/// The arm's time does not depend on this machine's speed, so the arm's speeds do not either.
TEST(EmulatedArm, TellsTheTimeOfItsTicks) {
  EmulatedArm arm(scenario::load_scenario(TACHLESS_SOURCE_DIR "/scenarios/practical_rigid.yaml"));
  const double before_s = arm.read().time_s;
  arm.start();
  for (int tick = 1; tick <= 3; ++tick) {
    EXPECT_DOUBLE_EQ(arm.read().time_s - before_s, tick * 1e-3);
    arm.hold(Vector::Zero(2), tick * 1e-3);
  }
}

/// The arm adds gravity while the scenario states that it adds nothing.
TEST(Commission, NamesTheKeyWhereGravityWouldBeSentTwice) {
  std::vector<std::string> says = {
      "plant.mechanics=native", "plant.initial.position_rad=[0.25, 0.2]",
      "robot.joints={rigid: {rotor_inertia_kgm2: [0.5, 0.1]}}",
      "reference={hold: {position_rad: [0.25, 0.2]}}", "plant.drive.torque_limit_Nm=[400, 100]"};
  const std::string path = TACHLESS_SOURCE_DIR "/scenarios/practical_rigid.yaml";
  const scenario::Scenario silent = scenario::load_scenario(path, says);
  says.emplace_back("robot.compensates.gravity=true");
  EmulatedArm maker(scenario::load_scenario(path, says));
  const Commissioned found = commission(silent, trials_on(maker), [](std::string_view) {});
  ASSERT_EQ(found.misfits.size(), 1U);
  EXPECT_THAT(found.misfits[0], HasSubstr("write robot.compensates: {gravity: true, friction: 0}"));
  EXPECT_THAT(found.overrides, testing::ElementsAre("robot.compensates.gravity=true",
                                                    "robot.compensates.friction=0"));
  EXPECT_TRUE(found.mendable);
}

/// An arm without brakes moves while a run has too few readings.
class MovedArm final : public EmulatedArm {
 public:
  using EmulatedArm::EmulatedArm;
  plant::ArmState read() override {
    plant::ArmState seen = EmulatedArm::read();
    seen.q.array() += moved_rad;
    return seen;
  }
  double moved_rad = 0;
};

/// A run begins at most 0.01 rad from where the arm is.
TEST(Commission, RepeatsATrialFromWhereTheArmIsThen) {
  const scenario::Scenario claimed = scenario::load_scenario(
      TACHLESS_SOURCE_DIR "/scenarios/practical_rigid.yaml",
      {"plant.mechanics=native", "plant.initial.position_rad=[0.25, 0.2]",
       "robot.joints={rigid: {rotor_inertia_kgm2: [0.5, 0.1]}}", "robot.compensates.gravity=true",
       "reference={hold: {position_rad: [0.25, 0.2]}}", "plant.drive.torque_limit_Nm=[400, 100]"});
  MovedArm arm(claimed);
  const Trials usable = trials_on(arm);
  int sent = 0;
  const Trials trials = [&](const scenario::Scenario& scenario,
                            const std::vector<std::string>& changes) -> std::optional<Trial> {
    auto trial = usable(scenario, changes);
    if (scenario.plant.dry_run || ++sent > 1) return trial;
    arm.moved_rad = 0.015;
    return {};
  };
  const Commissioned found = commission(claimed, trials, [](std::string_view) {});
  EXPECT_THAT(found.misfits, testing::IsEmpty());
  EXPECT_EQ(found.repeated, 1);

  const Trials never = [](const auto&, const auto&) { return std::optional<Trial>(); };
  EXPECT_THAT([&] { commission(claimed, never, [](std::string_view) {}); },
              testing::ThrowsMessage<base::Failure>(HasSubstr("late or missing ticks 4 times")));
}

/// TACHLESS_COMMISSION_ADVERSE=N tests N arms, from TACHLESS_COMMISSION_FIRST on.
TEST(Commission, NamesTheFaultsOfAdverseArmsAndIsSafe) {
  Tally tally;
  const int first = number_of("TACHLESS_COMMISSION_FIRST", 0);
  for (int arm = first; arm < first + number_of("TACHLESS_COMMISSION_ADVERSE", 27); ++arm) {
    std::mt19937 random(static_cast<unsigned>(100 + arm));
    const auto fault = static_cast<Fault>(arm % 9);
    const ArmKind& kind = kinds[static_cast<std::size_t>(arm / 9 + arm) % kinds.size()];
    tally.add(draw(random, kind, arm % 2 == 0, false, fault),
              fmt::format("arm {}, {}, {}: ", arm, kind.scenario, base::name_of(fault)));
  }
  std::cout << tally.text() << "\n";
  // 29 of 35 of 60 arms. Not named: joints that gravity loads lightly and whose torque is reversed,
  // and springs that a fall hides.
  EXPECT_GE(tally.named, 0.7 * tally.to_name);
  expect_right_and_safe(tally);
}

TEST(Commission, DeterminesTheShippedArmsWhereTheyBegin) {
  for (const char* name : {"ur5e", "iiwa_point_to_point", "xarm7", "panda", "fr3"}) {
    EmulatedArm arm(
        scenario::load_scenario(fmt::format("{}/scenarios/{}.yaml", TACHLESS_SOURCE_DIR, name),
                                {"plant.mechanics=native"}));
    const scenario::Scenario claimed = scenario::load_scenario(
        fmt::format("{}/scenarios/{}.yaml", TACHLESS_SOURCE_DIR, name), {"plant.mechanics=native"});
    const Commissioned found = commission(claimed, trials_on(arm), [](std::string_view) {});
    EXPECT_THAT(found.misfits, testing::IsEmpty()) << name << text(found, name);
    EXPECT_EQ(found.adds_gravity, claimed.robot.compensates.gravity) << name;
    EXPECT_EQ(found.delay, claimed.loop.command_delay + claimed.plant.encoder.latency_ticks)
        << name;
    for (const Commissioned::Joint& joint : found.joints) {
      EXPECT_TRUE(joint.scale && std::abs(*joint.scale - 1) < 0.05) << name << joint.name;
    }
  }
}

/// A count of 14 bits is 0.38 mrad: a fall of 40 counts would leave no room for the pulses.
TEST(Commission, DeterminesAnArmWithCoarseEncodersAtAFastAndASlowRate) {
  for (const char* period : {"0.001", "0.0025"}) {
    const scenario::Scenario claimed =
        scenario::load_scenario(TACHLESS_SOURCE_DIR "/examples/mit_can/arm.yaml",
                                {std::string("loop.period_s=") + period, "controller.gains.b=300"});
    EmulatedArm arm(claimed);
    const Commissioned found = commission(claimed, trials_on(arm), [](std::string_view) {});
    EXPECT_THAT(found.misfits, testing::IsEmpty()) << text(found, period);
    EXPECT_EQ(found.adds_gravity, false);
    EXPECT_EQ(found.delay, 2) << "command_delay and latency_ticks";
    EXPECT_EQ(found.unsent, Unsent::held);
    for (const Commissioned::Joint& joint : found.joints) {
      EXPECT_EQ(joint.turns, false) << period << joint.name;
      // Measured 1.007 at worst; a scale is open where the counts are as large as the motion.
      EXPECT_NEAR(joint.scale.value_or(1), 1, 0.03) << period << joint.name;
    }
  }
}

/// Torques of 12 bits over 54, 28 and 10 N m have no zero: half a step moves a light joint by 5
/// mrad in 0.2 s. Their driver adds what a step leaves over in the next ticks. Without that, joints
/// that drift are not determined, and nothing wrong is said.
TEST(Commission, DeterminesAnArmWithCoarseTorquesWhoseMeanIsRight) {
  const Vector ranges{{54, 54, 28, 28, 10, 10, 10}};
  for (const bool carries : {true, false}) {
    const scenario::Scenario claimed =
        scenario::load_scenario(TACHLESS_SOURCE_DIR "/examples/mit_can/arm.yaml");
    Hidden hidden{claimed, claimed, {Vector::Ones(7)}};
    hidden.more.torque_steps = ranges / 2047.5;
    hidden.more.carries = carries;
    Tally tally;
    tally.add(hidden, "coarse torques: ");
    EXPECT_EQ(tally.open == 0, carries) << tally.text();
    expect_right_and_safe(tally);
  }
}

TEST(Commission, RunsAtSevenPosturesOfAnFr3) {
  const std::string path = TACHLESS_SOURCE_DIR "/scenarios/fr3.yaml";
  for (const char* posture :
       {"[0, -0.7854, 0, -2.3562, 0, 1.5708, 0.7854]", "[0.5, 0.3, -0.4, -1.6, 0.2, 2.0, 0]",
        "[-0.6, -0.2, 0.5, -2.6, -0.4, 2.6, 1.2]", "[0, 0.6, 0, -0.8, 0, 1.2, 0.4]",
        "[1.2, -1.2, -0.8, -2.0, 1.0, 1.0, -1]", "[0, 0, 0, -1.5, 0, 1.5, 0]",
        "[-1, 1, 1, -2.2, 0.5, 3, 2]"}) {
    const scenario::Scenario arm = scenario::load_scenario(
        path, {fmt::format("plant.initial.position_rad={}", posture), "plant.mechanics=native",
               fmt::format("reference={{hold: {{position_rad: {}}}}}", posture)});
    Hidden hidden{arm, arm, {Vector::Ones(7)}};
    Tally tally;
    tally.add(hidden, fmt::format("fr3 at {}: ", posture));
    std::cout << posture << ": " << tally.text() << "\n";
    expect_right_and_safe(tally);
  }
}

/// TACHLESS_COMMISSION_ARMS=N tests N arms, from TACHLESS_COMMISSION_FIRST on.
TEST(Commission, IsRightAboutHiddenArmsOrSaysThatItDoesNotKnow) {
  Tally tally;
  const int first = number_of("TACHLESS_COMMISSION_FIRST", 0);
  for (int arm = first; arm < first + number_of("TACHLESS_COMMISSION_ARMS", 24); ++arm) {
    std::mt19937 random(static_cast<unsigned>(arm));
    const ArmKind& kind = kinds[static_cast<std::size_t>(arm) % kinds.size()];
    tally.add(draw(random, kind, arm % 2 == 0, arm % 7 == 3),
              fmt::format("arm {}, {}: ", arm, kind.scenario));
  }
  std::cout << tally.text() << "\n";
  // 650 statements of 60 arms are right, 454 not determined: most of these are of arms whose signs
  // the fall leaves open, so that no torque is known to hold them.
  EXPECT_GE(tally.right, tally.open);
  expect_right_and_safe(tally);
}

/// Their drivers add what a step of the torque leaves over in the next tick. Without that, a scale
/// or springs are wrongly named of 4 of 30 arms. TACHLESS_COMMISSION_COARSE=N tests N arms,
/// from TACHLESS_COMMISSION_FIRST on.
TEST(Commission, IsRightAboutHiddenArmsWithCoarseTorques) {
  Tally tally;
  const int first = number_of("TACHLESS_COMMISSION_FIRST", 0);
  for (int arm = first; arm < first + number_of("TACHLESS_COMMISSION_COARSE", 10); ++arm) {
    std::mt19937 random(static_cast<unsigned>(arm));
    const ArmKind& kind = kinds[static_cast<std::size_t>(arm) % kinds.size()];
    Hidden hidden = draw(random, kind, arm % 2 == 0, false);
    hidden.more.torque_steps = *hidden.truth.plant.drive.torque_limit_Nm / 2047.5;
    hidden.more.carries = true;
    tally.add(hidden, fmt::format("coarse arm {}, {}: ", arm, kind.scenario));
  }
  std::cout << tally.text() << "\n";
  expect_right_and_safe(tally);
}

}  // namespace
}  // namespace tachless::commission
