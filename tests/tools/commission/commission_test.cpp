// Many arms with hidden conventions. The findings of commission are right or "not determined", and
// no arm moves further or faster than allowed.

#include "commission/commission.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

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

namespace tachless::commission {
namespace {

using testing::HasSubstr;

/// Properties of an arm's drives that no scenario states.
struct DriveFaults {
  Vector scale;          ///< acting torque over sent torque
  int torque_delay = 0;  ///< until a sent torque acts [ticks]
  bool zeroes = false;   ///< zero torque without a command; otherwise the last one is held
  bool is_clock = false;
  bool braked = false;    ///< brakes that stay closed, or drives that ignore torques
  Vector encoders = {};   ///< -1: the encoder counts against the torque; empty: none does
  double cogging_Nm = 0;  ///< amplitude, 200 periods a turn
};

class FaultyArm final : public EmulatedArm {
 public:
  FaultyArm(const scenario::Scenario& scenario, DriveFaults faults)
      : EmulatedArm(scenario), faults_(std::move(faults)), first_(state().q) {}

  void start() override {
    EmulatedArm::start();
    last_ = Vector::Zero(first_.size());
    sent_.assign(static_cast<std::size_t>(faults_.torque_delay), Vector::Zero(first_.size()));
  }
  void hold(const Vector& tau, double until_s) override {
    last_ = tau;
    Vector acts = tau.cwiseProduct(faults_.scale);
    if (faults_.encoders.size() > 0) acts = acts.cwiseProduct(faults_.encoders);
    acts += faults_.cogging_Nm * (200 * state().q).array().sin().matrix();
    sent_.push_back(acts);
    if (!faults_.braked) EmulatedArm::hold(sent_.front(), until_s);
    sent_.pop_front();
    moved = moved.cwiseMax((state().q - first_).cwiseAbs());
    fastest = fastest.cwiseMax(state().v.cwiseAbs());
  }

  void rest(double until_s) override {
    if (moves()) hold(faults_.zeroes ? Vector::Zero(first_.size()) : last_, until_s);
  }

 private:
  DriveFaults faults_;
  Vector first_, last_;
  std::deque<Vector> sent_;  ///< torques that do not act yet

 public:
  /// Largest deflection from the start [rad; m], and largest speed.
  Vector moved = Vector::Zero(first_.size()), fastest = moved;
};

/// An arm whose ticks are the clock of the run.
class ClockedArm final : public plant::ClockDriver {
 public:
  ClockedArm(FaultyArm& arm, double period_s) : arm_(arm), period_s_(period_s) {}

  [[nodiscard]] bool measures_velocity() const override { return false; }
  void start() override {
    arm_.start();
    ticks_ = -1;
  }
  void stop() override { arm_.stop(); }

 private:
  plant::ArmState exchange(const Vector& tau) override {
    const double until_s = static_cast<double>(++ticks_) * period_s_;
    if (tau.size() > 0) {
      arm_.hold(tau, until_s);
    } else if (ticks_ > 0) {
      arm_.rest(until_s);
    }
    return arm_.read();
  }

  FaultyArm& arm_;
  double period_s_;
  std::int64_t ticks_ = 0;
};

/// An arm, and the scenario of somebody who does not know its conventions.
struct Hidden {
  scenario::Scenario claimed, truth;
  DriveFaults more;
};

std::string list(const Vector& values) { return fmt::format("[{}]", fmt::join(values, ", ")); }

struct ArmKind {
  const char* scenario;
  std::vector<double> posture;
  std::vector<double> rotor;     ///< [kg m^2]
  std::vector<double> friction;  ///< dry friction [N m]
  std::string torque_limit;
  int bits;
};

const std::vector<ArmKind> kinds = {
    {"practical_rigid", {0.25, 0.2}, {0.5, 0.1}, {0.5, 0.1}, "[400, 100]", 20},
    {"practical_rigid", {2.9, 0.25}, {1, 0.2}, {1, 0.15}, "[400, 100]", 19},
    {"ur5e",
     {0.2, -1.4, 0.3, -1.4, 0.4, 0.3},
     {0.7, 0.7, 0.7, 0.2, 0.2, 0.2},
     {0.6, 0.6, 0.6, 0.1, 0.1, 0.1},
     "[150, 150, 150, 28, 28, 28]",
     21},
    {"iiwa_point_to_point",
     {0.3, 0.15, -0.4, -0.2, 0.3, 0.3, 0.2},
     {0.6, 0.6, 0.4, 0.4, 0.2, 0.1, 0.1},
     {0.5, 0.5, 0.3, 0.3, 0.2, 0.1, 0.1},
     "[320, 320, 176, 176, 110, 40, 40]",
     22}};

Hidden draw(std::mt19937& random, const ArmKind& kind, bool friction, bool wild) {
  std::uniform_real_distribution<double> part(0, 1);
  const auto flip = [&](double share) { return part(random) < share; };
  std::vector<std::string> common = {
      "plant.mechanics=native",
      "plant.integrator.accuracy=1e-8",
      "plant.on_limit=warn",
      fmt::format("plant.encoder.resolution_bits={}", kind.bits),
      "loop.command_delay=1",
      "plant.drive.torque_limit_Nm=" + kind.torque_limit,
      fmt::format("robot.joints={{rigid: {{rotor_inertia_kgm2: [{}]}}}}",
                  fmt::join(kind.rotor, ", "))};
  const auto n = static_cast<Eigen::Index>(kind.posture.size());
  if (friction) {
    common.push_back(
        fmt::format("plant.drive.coulomb_friction_Nm=[{}]", fmt::join(kind.friction, ", ")));
  }
  Vector signs = Vector::Ones(n), posture(n), scale = signs;
  for (Eigen::Index i = 0; i < n; ++i) {
    posture[i] = kind.posture[static_cast<std::size_t>(i)];
    if (flip(0.25)) signs[i] = -1;
    scale[i] = wild ? 0.7 * std::pow(2, part(random)) : 0.95 + 0.1 * part(random);
  }
  const std::string path = fmt::format("{}/scenarios/{}.yaml", TACHLESS_SOURCE_DIR, kind.scenario);
  const auto with = [&](std::vector<std::string> more) {
    more.insert(more.begin(), common.begin(), common.end());
    return scenario::load_scenario(path, more);
  };
  const Vector seen = signs.cwiseProduct(posture);
  const double which = part(random);
  const char* compensates =
      which < 0.4 ? "{}"
                  : (which < 0.7 || !friction ? "{gravity: true}" : "{gravity: true, friction: 1}");
  const int delay = static_cast<int>(5 * part(random)),
            of_reading = static_cast<int>((delay + 1) * part(random));
  const auto at = [](const Vector& q) {
    return fmt::format("plant.initial.position_rad={}", list(q));
  };
  const auto hold = [](const Vector& q) {
    return fmt::format("reference={{hold: {{position_rad: {}}}}}", list(q));
  };
  return {with({at(seen), hold(seen)}),
          with({at(posture), hold(posture), "robot.joint_signs=" + list(signs),
                fmt::format("robot.compensates={}", compensates),
                fmt::format("plant.encoder.latency_ticks={}", of_reading)}),
          {scale, delay - of_reading, flip(0.5), flip(0.5)}};
}

/// Counts of the findings.
struct Tally {
  int arms = 0, refused = 0, gravity = 0, friction = 0, delay = 0, joints = 0, signs = 0,
      scales = 0, unsent = 0;
  /// Largest deflection [rad; m], speed over its limit, and error of scale.
  double farthest = 0, fastest = 0, scale = 0;

  void check(const Hidden& arm, const std::string& what) {
    SCOPED_TRACE(what);
    FaultyArm driver(arm.truth, arm.more);
    ClockedArm clocked(driver, arm.truth.loop.period_s);
    plant::RobotDriver& as_driven =
        arm.more.is_clock ? static_cast<plant::RobotDriver&>(clocked) : driver;
    Commissioned found;
    ++arms;
    try {
      found = commission(arm.claimed, trials_on(as_driven), [](std::string_view) {});
      EXPECT_EQ(found.arm_is_clock, arm.more.is_clock);
      EXPECT_LT(found.seconds, 90);
    } catch (const base::Failure& failure) {
      std::cout << what << ": " << failure.what() << "\n";
      ++refused;
    }
    const Vector& limit = arm.truth.model->velocity_limit;
    for (Eigen::Index i = 0; i < limit.size(); ++i) {
      // The speed is a mean over 20 ms.
      EXPECT_LT(driver.fastest[i], 0.12 * (std::isfinite(limit[i]) ? limit[i] : 1));
    }
    for (Eigen::Index i = 0; i < limit.size(); ++i) {
      farthest = std::max(farthest, driver.moved[i]);
      fastest = std::max(fastest, driver.fastest[i] / (std::isfinite(limit[i]) ? limit[i] : 1));
    }
    EXPECT_LT(driver.moved.maxCoeff(), 0.05);
    if (std::getenv("SHOW")) {
      std::cout << what << " compensates " << arm.truth.robot.compensates.text() << " signs "
                << list(arm.truth.robot.joint_signs) << " delay " << arm.more.torque_delay << "+"
                << arm.truth.plant.encoder.latency_ticks << " scale " << list(arm.more.scale)
                << "\n  moved " << list(driver.moved) << " fast " << list(driver.fastest) << "\n"
                << text(found, what);
      for (const auto& m : found.misfits) std::cout << "  ! " << m << "\n";
    }
    const auto& compensates = arm.truth.robot.compensates;
    const bool gravity = compensates.gravity;
    if (found.adds_gravity) {
      EXPECT_EQ(*found.adds_gravity, gravity);
      ++this->gravity;
    }
    if (found.adds_friction) {
      EXPECT_EQ(*found.adds_friction, compensates.friction == 1);
      ++friction;
    }
    if (found.delay) {
      EXPECT_EQ(*found.delay, 1 + arm.more.torque_delay + arm.truth.plant.encoder.latency_ticks);
      ++delay;
    }
    if (found.unsent) {
      EXPECT_EQ(*found.unsent, arm.more.zeroes ? Unsent::zeroed : Unsent::held);
      ++unsent;
    }
    for (std::size_t j = 0; j < found.joints.size(); ++j) {
      const auto i = static_cast<Eigen::Index>(j);
      const Commissioned::Joint& joint = found.joints[j];
      ++joints;
      if (joint.turns) {
        ++signs;
        EXPECT_EQ(*joint.turns, arm.truth.robot.joint_signs[i] < 0) << joint.name;
      }
      if (joint.scale) {
        ++scales;
        scale = std::max(scale, std::abs(*joint.scale / arm.more.scale[i] - 1));
      }
    }
  }
};

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

/// An arm of the scenario whose drives have faults, and what the commissioning says of it.
std::string said_of(const std::string& name, const std::vector<std::string>& truth,
                    const DriveFaults& faults) {
  const std::string path = fmt::format("{}/scenarios/{}.yaml", TACHLESS_SOURCE_DIR, name);
  const std::vector<std::string> both = {"plant.mechanics=native", "plant.on_limit=warn"};
  std::vector<std::string> of_arm = both;
  of_arm.insert(of_arm.end(), truth.begin(), truth.end());
  FaultyArm arm(scenario::load_scenario(path, of_arm), faults);
  const scenario::Scenario claimed = scenario::load_scenario(path, both);
  std::string said;
  try {
    const Commissioned found = commission(claimed, trials_on(arm), [](std::string_view) {});
    EXPECT_NE(found.adds_gravity, false) << name;  // each of these arms adds gravity
    said = fmt::format("{}", fmt::join(found.misfits, "\n"));
  } catch (const base::Failure& failure) {
    said = failure.what();
  }
  const Vector& limit = claimed.model->velocity_limit;
  for (Eigen::Index i = 0; i < limit.size(); ++i) {
    EXPECT_LT(arm.fastest[i], 0.12 * (std::isfinite(limit[i]) ? limit[i] : 1)) << name;
  }
  EXPECT_LT(arm.moved.maxCoeff(), 0.04) << name;  // 0.02 from the reference in each trial
  if (std::getenv("SHOW")) {
    std::cout << name << " moved " << list(arm.moved) << " fast " << list(arm.fastest) << "\n"
              << said << "\n";
  }
  return said;
}

const std::vector<std::string> adds_gravity = {"robot.compensates={gravity: true}"};

TEST(Commission, NamesBrakesAndConcludesNothingFromRoundingNoise) {
  for (const char* name : {"ur5e", "iiwa_point_to_point", "fr3"}) {
    DriveFaults faults;
    const scenario::Scenario scenario =
        scenario::load_scenario(fmt::format("{}/scenarios/{}.yaml", TACHLESS_SOURCE_DIR, name));
    faults.scale = Vector::Ones(scenario.num_joints);
    faults.braked = true;
    const std::string said = said_of(name, adds_gravity, faults);
    EXPECT_THAT(said, HasSubstr("moves less than 10 counts")) << name;
    EXPECT_THAT(said, testing::Not(HasSubstr("joint_signs"))) << name;
  }
}

TEST(Commission, NamesAnEncoderThatCountsAgainstItsTorqueOrNothing) {
  int times_named = 0;
  for (const char* name : {"ur5e", "iiwa_point_to_point", "fr3"}) {
    const scenario::Scenario scenario =
        scenario::load_scenario(fmt::format("{}/scenarios/{}.yaml", TACHLESS_SOURCE_DIR, name));
    for (Eigen::Index joint = 0; joint < scenario.num_joints; joint += 3) {
      DriveFaults faults;
      faults.scale = faults.encoders = Vector::Ones(scenario.num_joints);
      faults.encoders[joint] = -1;
      const std::string said = said_of(name, adds_gravity, faults);
      const std::string named =
          robot::joint_labels(*scenario.model).joint(static_cast<std::size_t>(joint)) +
          " moves against its own torque";
      EXPECT_THAT(said, testing::AnyOf(HasSubstr(named), HasSubstr("not determined"))) << name;
      times_named += said.find(named) != std::string::npos ? 1 : 0;
    }
  }
  // 3 of 8: the others reach the guard before a second answer confirms the first.
  EXPECT_GE(times_named, 3);
}

TEST(Commission, NamesATorqueThatActsAHundredfold) {
  for (const char* name : {"ur5e", "iiwa_point_to_point", "fr3"}) {
    const scenario::Scenario scenario =
        scenario::load_scenario(fmt::format("{}/scenarios/{}.yaml", TACHLESS_SOURCE_DIR, name));
    DriveFaults faults;
    faults.scale = Vector::Constant(scenario.num_joints, 100);
    EXPECT_THAT(said_of(name, adds_gravity, faults), HasSubstr("times the torque that it is sent"));
  }
}

/// The motion decides little here. No statement is wrong, and no joint goes far.
TEST(Commission, IsSafeWithLoadsWallsAndCogging) {
  for (const char* name : {"ur5e", "iiwa_point_to_point"}) {
    const scenario::Scenario scenario =
        scenario::load_scenario(fmt::format("{}/scenarios/{}.yaml", TACHLESS_SOURCE_DIR, name));
    DriveFaults faults;
    faults.scale = Vector::Ones(scenario.num_joints);
    said_of(name, {"robot.compensates={gravity: true}", "plant.payload={mass_kg: 3}"}, faults);
    said_of(name, {"robot.compensates={gravity: true}", "robot.base={rpy: [0, 1.57, 0]}"}, faults);
    faults.cogging_Nm = 2e-4;  // the wrists have no rotors
    said_of(name, adds_gravity, faults);
  }
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
    EXPECT_EQ(found.delay,
              std::max(1, claimed.loop.command_delay) + claimed.plant.encoder.latency_ticks)
        << name;
    for (const Commissioned::Joint& joint : found.joints) {
      EXPECT_TRUE(joint.scale && std::abs(*joint.scale - 1) < 0.05) << name << joint.name;
    }
  }
}

/// TACHLESS_COMMISSION_ARMS=N tests N arms.
TEST(Commission, IsRightAboutHiddenArmsOrSaysThatItDoesNotKnow) {
  const char* many = std::getenv("TACHLESS_COMMISSION_ARMS");
  std::mt19937 random(5);
  Tally tally;
  for (int arm = 0; arm < (many != nullptr ? std::atoi(many) : 40); ++arm) {
    const ArmKind& kind = kinds[static_cast<std::size_t>(arm % 8 < 6 ? arm % 2 : arm % 8 - 4)];
    tally.check(draw(random, kind, arm % 2 == 0, arm % 7 == 3),
                fmt::format("arm {}, {}", arm, kind.scenario));
  }
  std::cout << fmt::format(
      "{} arms, {} refused; told: gravity {}, friction {}, delay {}, unsent {}, signs {} and "
      "scales {} of {}, "
      "within "
      "{:.3g}; moved {:.3g} rad, {:.3g} of the speed limit\n",
      tally.arms, tally.refused, tally.gravity, tally.friction, tally.delay, tally.unsent,
      tally.signs, tally.scales, tally.joints, tally.scale, tally.farthest, tally.fastest);
  // With 40 arms, gravity is determined for 40, delay for 34 and scale for 109 joints. Properties
  // that the motion does not show stay undetermined.
  EXPECT_GE(tally.gravity, 0.9 * tally.arms);
  EXPECT_GE(tally.delay, 0.7 * tally.arms);
  EXPECT_GE(tally.scales, 0.7 * tally.joints);
  EXPECT_LT(tally.scale, 0.1);  // friction may hide up to 6 % of the torque that moves a joint
}

}  // namespace
}  // namespace tachless::commission
