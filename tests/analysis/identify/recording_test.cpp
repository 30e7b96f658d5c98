// The data that identification takes from a log: for a real arm also its initial position and
// torque.

#include "identify/recording.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstddef>
#include <fstream>
#include <span>
#include <string>
#include <vector>

#include "base/failure.h"
#include "identify/output_error.h"
#include "messages/truth/truth_wire.h"
#include "robot/dynamics.h"
#include "session/run_info.h"
#include "tests/analysis/identify/hidden_arm.h"
#include "tests/support/in_process_log.h"
#include "tests/support/temporary_directory.h"

namespace tachless::identify {
namespace {

class RecordingOfALog : public testing::Test {
 protected:
  /// Returns a motion about a posture where gravity pulls.
  static scenario::Scenario arm(std::vector<std::string> overrides = {}) {
    overrides.insert(overrides.begin(),
                     {"plant.mechanics=native", "plant.integrator.accuracy=1e-8",
                      "plant.initial.position_rad=[0.8, -0.3]", multi_sine("[0.8, -0.3]", 2)});
    return support::shortened("practical_rigid.yaml", "3", overrides);
  }

  static std::string run_info_of(const scenario::Scenario& believed) {
    const auto info =
        session::run_info(believed, 7, controller::law_info(*controller::scenario_law(believed)));
    return {reinterpret_cast<const char*>(info.data()), info.size()};
  }

  /// Returns the recording of a run of `there` whose RUN_INFO states the scenario `believed`.
  Recording recorded(const scenario::Scenario& there, const scenario::Scenario& believed) const {
    auto messages = support::in_process_log(there);
    messages.front().data = run_info_of(believed);
    std::ofstream(directory_ / "lcmlog", std::ios::binary) << logger::log_of(messages);
    return read_recording(directory_ / "lcmlog");
  }

  TemporaryDirectory directory_;
};

/// A driver may begin within 10 mrad of the scenario's start. From then on it holds the arm.
TEST_F(RecordingOfALog, BeginsWhereARealArmBeganAndUnderItsTorque) {
  const scenario::Scenario there =
      arm({"plant.initial.position_rad=[0.805, -0.308]", "plant.initial.torque=hold"});
  const Recording run = recorded(there, arm());
  const plant::InitialState& initial = run.scenario.plant.initial;
  EXPECT_EQ(initial.position_rad, Vector(run.q.row(0).transpose()));
  EXPECT_EQ(initial.torque_Nm, Vector(run.tau.row(0).transpose()));
  EXPECT_GT(initial.torque_Nm.norm(), 10);
  const Parameters parameters(run.scenario, {Kind::payload});
  const Eigen::VectorXd none = Eigen::VectorXd::Zero(1);
  // At the start and later, both positions are within half a count of 2 pi / 2^20, or 3e-6 rad.
  EXPECT_LT(simulated_residual(run, parameters, none).cwiseAbs().maxCoeff(), 1e-5);
  Recording as_the_scenario_says = run;
  as_the_scenario_says.scenario.plant.initial.torque_Nm = Eigen::Vector2d::Zero();
  EXPECT_GT(simulated_residual(as_the_scenario_says, parameters, none).cwiseAbs().maxCoeff(), 3e-5);
}

TEST_F(RecordingOfALog, BeginsWhereTheScenarioSaysIfItsEncodersMaySay) {
  for (const std::vector<std::string>& encoders :
       {std::vector<std::string>{"plant.encoder.resolution_bits=10"},
        {"plant.encoder.noise_std_rad=1e-3"},
        {"plant.encoder.eccentricity_rad=0.01", "plant.encoder.eccentricity_phase_rad=1"},
        {"plant.initial.torque=hold"}}) {
    const scenario::Scenario there = arm(encoders);
    const plant::InitialState& initial = recorded(there, there).scenario.plant.initial;
    EXPECT_EQ(initial.position_rad, Vector(Eigen::Vector2d(0.8, -0.3))) << encoders.front();
    EXPECT_EQ(initial.torque, there.plant.initial.torque);
    EXPECT_TRUE(initial.torque_Nm.isZero(0));
  }
}

/// The log of a driver has its readings as the arm's state. The emulator's arm adds nothing.
TEST_F(RecordingOfALog, HasTheTorqueThatADriversArmAdds) {
  const std::vector<std::string> adds = {"robot.compensates.gravity=true", "loop.mode=realtime"};
  const auto with = [&](const char* encoder) {
    std::vector<std::string> all = adds;
    all.emplace_back(encoder);
    return arm(all);
  };
  const scenario::Scenario counts = with("plant.encoder.resolution_bits=18"),
                           exact = with("plant.encoder.resolution_bits=null");
  EXPECT_EQ(recorded(counts, counts).own.size(), 0);
  const Recording run = recorded(exact, exact);
  ASSERT_EQ(run.own.rows(), run.num_ticks());
  const Vector gravity = robot::gravity_torque(*exact.model, run.q.row(100).transpose());
  EXPECT_EQ(Vector(run.own.row(100).transpose()), gravity);
  EXPECT_EQ(run.scenario.plant.initial.torque, plant::InitialTorque::hold);
}

/// An arm whose sensors behind the gears measure half of the torque that the drives give.
TEST_F(RecordingOfALog, HasTheTorquesThatTheArmTold) {
  const std::vector<std::string> drives = {
      "plant.drive.viscous_friction_Nms_per_rad=[2, 1]", "plant.drive.coulomb_friction_Nm=[5, 0.5]",
      "robot.joints={rigid: {rotor_inertia_kgm2: [0.2, 0.1]}}"};
  std::vector<std::string> realtime = drives;
  realtime.emplace_back("loop.mode=realtime");  // only an arm tells torques
  const scenario::Scenario there = arm(drives), believed = arm(realtime);
  auto messages = support::in_process_log(there);
  messages.front().data = run_info_of(believed);
  const messages::Layout layout = messages::layout(2, false);
  const auto told = [&](const messages::truth::PlantTruth& truth) {
    return messages::truth::ArmTorque{truth.tau.array() + 1, 0.5 * truth.tau};
  };
  const auto write = [&](bool tells) {
    std::vector<logger::Recorded> all;
    for (const logger::Recorded& each : messages) {
      all.push_back(each);
      if (!tells || !each.channel.ends_with("_TRUTH")) continue;
      const auto bytes = std::as_bytes(std::span(each.data));
      messages::Stamp stamp;
      messages::truth::PlantTruth truth;
      messages::Codec<messages::truth::PlantTruth>(layout).decode(bytes, stamp, truth);
      messages::Codec<messages::truth::ArmTorque> codec(layout);
      const auto arm_torque = codec.encode(stamp, told(truth));
      all.push_back({each.utime,
                     each.channel.substr(0, each.channel.size() - 5) + "ARM_TORQUE",
                     {reinterpret_cast<const char*>(arm_torque.data()), arm_torque.size()}});
    }
    std::ofstream(directory_ / "lcmlog", std::ios::binary) << logger::log_of(all);
  };
  const auto read = [&](TorqueSource source) {
    return read_recording(directory_ / "lcmlog", source);
  };
  write(true);
  const Recording commanded = read(TorqueSource::commanded),
                  accepted = read(TorqueSource::accepted), measured = read(TorqueSource::measured),
                  behind_gear = read(TorqueSource::behind_gear);
  EXPECT_TRUE(commanded.controlled);
  EXPECT_EQ(accepted.tau, Eigen::MatrixXd(commanded.tau.array() + 1));
  EXPECT_EQ(measured.tau, Eigen::MatrixXd(0.5 * commanded.tau));
  EXPECT_EQ(behind_gear.tau, measured.tau);
  EXPECT_EQ(measured.q, commanded.q);
  for (const Recording* each : {&accepted, &measured, &behind_gear}) {
    EXPECT_FALSE(each->controlled) << "the law's loop is not simulated with such torques";
  }
  EXPECT_FALSE(measured.scenario.plant.drive.coulomb_friction_Nm.isZero(0));
  EXPECT_TRUE(behind_gear.scenario.plant.drive.coulomb_friction_Nm.isZero(0));
  EXPECT_TRUE(behind_gear.scenario.plant.drive.viscous_friction_Nms_per_rad.isZero(0));
  EXPECT_TRUE(behind_gear.scenario.robot.rigid_rotor_inertia_kgm2.isZero(0));
  write(false);
  EXPECT_NO_THROW(read(TorqueSource::commanded));
  try {
    read(TorqueSource::measured);
    ADD_FAILURE();
  } catch (const base::Failure& failure) {
    EXPECT_THAT(failure.what(), testing::HasSubstr("holds no torque that the arm measured"));
  }
}

/// Arms lose readings now and then: four ticks of 3000 here, then 21 in a row of 1 ms.
TEST_F(RecordingOfALog, FillsAFewMissingTicksAndIsRefusedWithMany) {
  const auto whole = support::in_process_log(arm());
  const auto without = [&](std::int64_t first, std::int64_t count) {
    auto messages = whole;
    const auto begin = messages.begin() + 1 + 6 * first;
    messages.erase(begin, begin + 6 * count);
    std::ofstream(directory_ / "lcmlog", std::ios::binary) << logger::log_of(messages);
    return read_recording(directory_ / "lcmlog");
  };
  const Recording complete = without(0, 0), filled = without(500, 4);
  EXPECT_EQ(complete.missed, 0);
  EXPECT_TRUE(complete.controlled);
  EXPECT_EQ(filled.missed, 4);
  EXPECT_FALSE(filled.controlled) << "the law stepped over the ticks";
  ASSERT_EQ(filled.num_ticks(), complete.num_ticks());
  EXPECT_EQ(filled.q.bottomRows(2000), complete.q.bottomRows(2000));
  const Eigen::RowVectorXd before = complete.q.row(499), after = complete.q.row(504);
  EXPECT_LT((filled.q.row(502) - (0.4 * before + 0.6 * after)).norm(), 1e-12);
  EXPECT_EQ(filled.tau.row(503), complete.tau.row(499));
  try {
    without(500, 21);
    ADD_FAILURE();
  } catch (const base::Failure& failure) {
    EXPECT_THAT(failure.what(),
                testing::HasSubstr("21 of 3000 ticks are missed, up to 21 in a row are missing; "
                                   "allowed: 20 % and 20 ms"));
  }
}

TEST_F(RecordingOfALog, IsRefusedWhereTheArmWasSentNothing) {
  for (const char* nothing :
       {"plant.dry_run=true", "plant.withheld_ticks=2", "plant.zero_torque=true"}) {
    try {
      recorded(arm(), arm({nothing}));
      ADD_FAILURE() << nothing;
    } catch (const base::Failure& failure) {
      EXPECT_THAT(failure.what(), testing::HasSubstr("the robot was sent nothing")) << nothing;
    }
  }
}

}  // namespace
}  // namespace tachless::identify
