// The plant on the wall clock against peers that answer at once, or as a test wants it: what it
// makes of commands does not depend on how busy the machine is.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <thread>
#include <vector>

#include "tests/plant/peers.h"
#include "tests/support/limited_elbow.h"

namespace tachless::plant {
namespace {

using namespace std::chrono_literals;
using base::ExitCode;
using messages::truth::DriveFault;
using testing::HasSubstr;

std::vector<double> first_torques(const Peers& peers) {
  std::vector<double> result;
  for (const auto& truth : peers.truths) result.push_back(truth.tau[0]);
  return result;
}

TEST(RealtimeLoop, AppliesEachCommandOverTheNextTickAndNothingOverTheFirst) {
  const scenario::Scenario s = scenario({});
  ASSERT_EQ(s.loop.command_delay, 1);
  Peers peers(s);
  const Outcome outcome = run(s, peers);
  ASSERT_EQ(outcome.fault, "");
  ASSERT_EQ(peers.truths.size(), 30u);
  EXPECT_EQ(peers.truths[0].tau, Vector::Zero(2));
  for (std::size_t k = 1; k < 30; ++k) {
    EXPECT_EQ(peers.truths[k].tau, torque_of(static_cast<std::int64_t>(k) - 1)) << k;
    EXPECT_EQ(peers.truths[k].fault, DriveFault::none) << k;
  }
  EXPECT_EQ(outcome.statistics.plant().missed_commands, 0);
  EXPECT_EQ(outcome.statistics.plant().command_age_us.count(), 30);
  EXPECT_EQ(outcome.statistics.plant().wake_up_jitter_us.count(), 30);
}

TEST(RealtimeLoop, DelayShiftsTheTorquesByExactlyOneTick) {
  const scenario::Scenario late = scenario({});
  const scenario::Scenario prompt = scenario({"loop.command_delay=0"});
  Peers late_peers(late);
  Peers prompt_peers(prompt);
  ASSERT_EQ(run(late, late_peers).fault, "");
  ASSERT_EQ(run(prompt, prompt_peers).fault, "");
  std::vector<double> shifted = first_torques(prompt_peers);
  ASSERT_EQ(shifted.size(), 30u);
  EXPECT_EQ(shifted[0], torque_of(0)[0]);
  shifted.insert(shifted.begin(), 0.0);
  shifted.pop_back();
  EXPECT_EQ(first_torques(late_peers), shifted);
}

TEST(RealtimeLoop, HoldsTheLastTorqueWhenCommandsAreMissed) {
  for (const std::int64_t delay : {0, 1}) {
    SCOPED_TRACE(delay);
    const scenario::Scenario s = scenario({"loop.command_delay=" + std::to_string(delay)});
    Peers peers(s);
    peers.on_measurement = [&](std::int64_t k) {
      if (k < 5 || k > 7) peers.command(k, torque_of(k));
    };
    const Outcome outcome = run(s, peers);
    ASSERT_EQ(outcome.fault, "");
    ASSERT_EQ(peers.truths.size(), 30u);
    for (std::int64_t k = 0; k < 30; ++k) {
      const auto& truth = peers.truths[static_cast<std::size_t>(k)];
      const bool missed = k - delay >= 5 && k - delay <= 7;
      EXPECT_EQ(truth.fault, missed ? DriveFault::command_missed : DriveFault::none) << k;
      if (k < delay) continue;
      EXPECT_EQ(truth.tau, torque_of(missed ? 4 : k - delay)) << k;
    }
    EXPECT_EQ(outcome.statistics.plant().missed_commands, 3);
    EXPECT_EQ(outcome.statistics.plant().longest_command_miss, 3);
  }
}

TEST(RealtimeLoop, CountsALateCommandAndDoesNotApplyIt) {
  const scenario::Scenario s = scenario({});
  Peers peers(s);
  peers.on_measurement = [&](std::int64_t k) {
    if (k == 6) peers.command(5, torque_of(5));
    if (k != 5) peers.command(k, torque_of(k));
  };
  const Outcome outcome = run(s, peers);
  ASSERT_EQ(outcome.fault, "");
  EXPECT_EQ(outcome.statistics.plant().late_commands, 1);
  EXPECT_EQ(outcome.statistics.plant().missed_commands, 1);
  EXPECT_EQ(peers.truths[6].tau, torque_of(4));
  EXPECT_EQ(peers.truths[7].tau, torque_of(6));
}

TEST(RealtimeLoop, IgnoresACommandOfATickThatHasNotBegun) {
  const scenario::Scenario s = scenario({});
  Peers peers(s);
  peers.on_measurement = [&](std::int64_t k) {
    peers.command(k + 1, Vector::Constant(2, 1e6));
    peers.command(k, torque_of(k));
  };
  const Outcome outcome = run(s, peers);
  ASSERT_EQ(outcome.fault, "");
  EXPECT_EQ(outcome.statistics.rejected.total(), 30);
  EXPECT_EQ(peers.truths[9].tau, torque_of(8));
}

TEST(RealtimeLoop, BeginsNoTickBeforeItsDeadlineAndNumbersThemAll) {
  const scenario::Scenario s = scenario({});
  Peers peers(s);
  ASSERT_EQ(run(s, peers).fault, "");
  ASSERT_EQ(peers.ticks.size(), 30u);
  for (std::int64_t k = 0; k < 30; ++k) {
    EXPECT_EQ(peers.ticks[static_cast<std::size_t>(k)], k);
    EXPECT_GE(peers.tick_utimes[static_cast<std::size_t>(k)], 1000 * k);
  }
}

TEST(RealtimeLoop, CountsDeadlinesItMissesAndLosesNoTickOverThem) {
  const scenario::Scenario s = scenario({});
  Peers peers(s);
  peers.on_measurement = [&](std::int64_t k) {
    peers.command(k, torque_of(k));
    if (k == 10) std::this_thread::sleep_for(5500us);  // into tick 15
  };
  const Outcome outcome = run(s, peers);
  ASSERT_EQ(outcome.fault, "");
  EXPECT_EQ(peers.truths.size(), 30u);
  // Ticks 11 to 14 begin later than one period after their deadlines.
  EXPECT_GE(outcome.statistics.plant().missed_deadlines, 4);
  EXPECT_GE(outcome.statistics.plant().longest_miss, 4);
  EXPECT_GE(outcome.statistics.plant().wake_up_jitter_us.max_us(), 4000);
  EXPECT_EQ(peers.truths[29].tau, torque_of(28));
}

TEST(RealtimeLoop, NotesThatMoreDeadlinesWereMissedThanTheScenarioAllows) {
  for (const char* share : {"0.1", "1"}) {
    SCOPED_TRACE(share);
    const scenario::Scenario s = scenario({std::string("loop.max_missed_share=") + share});
    Peers peers(s);
    peers.on_measurement = [&](std::int64_t k) {
      peers.command(k, torque_of(k));
      if (k == 10) std::this_thread::sleep_for(6500us);  // 5 of 30 begin too late
    };
    const Outcome outcome = run(s, peers);
    ASSERT_EQ(outcome.fault, "") << "the run itself comes to its end";
    EXPECT_EQ(peers.truths.size(), 30u);
    const bool allowed = std::string_view(share) == "1";
    EXPECT_EQ(outcome.statistics.exit_code, allowed ? ExitCode::done : ExitCode::check_said_no);
    EXPECT_EQ(outcome.statistics.fault.has_value(), !allowed);
    if (allowed) continue;
    EXPECT_THAT(*outcome.statistics.fault, testing::AllOf(HasSubstr("of 30 deadlines were missed"),
                                                          HasSubstr("loop.max_missed_share (0.1)"),
                                                          HasSubstr("tachless doctor")));
  }
}

TEST(RealtimeLoop, GivesTicksThatItIsLateForTimeForTheirCommands) {
  const scenario::Scenario s = scenario({"loop.duration_s=0.1"});
  ASSERT_EQ(s.loop.max_missed, 20);
  Peers peers(s);
  peers.answering_time = 200us;
  peers.on_measurement = [&](std::int64_t k) {
    peers.command(k, torque_of(k));
    if (k == 10) std::this_thread::sleep_for(30ms);  // the machine stands still
  };
  const Outcome outcome = run(s, peers);
  ASSERT_EQ(outcome.fault, "");
  EXPECT_EQ(peers.truths.size(), 100u);
  EXPECT_GE(outcome.statistics.plant().longest_miss, 29);
  const auto delay_us = [&](std::size_t k) {
    return peers.tick_utimes[k] - 1000 * static_cast<std::int64_t>(k);
  };
  EXPECT_GE(delay_us(11), 28'000);
  // It does catch up: a late tick takes less than its period, unless the machine stands still
  // again.
  std::int64_t shortest_us = 1000;
  for (std::size_t k = 12; k < 100; ++k) {
    shortest_us = std::min(shortest_us, peers.tick_utimes[k] - peers.tick_utimes[k - 1]);
  }
  EXPECT_LT(shortest_us, 800);
}

class Stopping : public testing::Test {
 protected:
  const scenario::Scenario s_ = scenario(
      {"loop.duration_s=2", "loop.max_missed=3", "plant.initial.velocity_rad_per_s=[1.5, -2]"});
  Peers peers_{s_};
};

TEST_F(Stopping, BrakesViscouslyWhenTooManyCommandsAreMissed) {
  peers_.on_measurement = [&](std::int64_t k) {
    if (k < 10) peers_.command(k, Vector::Zero(2));
  };
  const Outcome outcome = run(s_, peers_);
  EXPECT_EQ(outcome.code, ExitCode::protective_stop);
  EXPECT_THAT(outcome.fault, HasSubstr("4 commands in a row"));
  EXPECT_THAT(outcome.fault, HasSubstr("loop.max_missed (3)"));
  EXPECT_EQ(outcome.statistics.plant().longest_command_miss, 4);

  // Ticks 10 to 13 go without; 14 is the first that is braked.
  ASSERT_GT(peers_.truths.size(), 20u);
  for (std::size_t k = 0; k < peers_.truths.size(); ++k) {
    EXPECT_EQ(peers_.truth_ticks[k], static_cast<std::int64_t>(k));
    const auto fault = peers_.truths[k].fault;
    if (k >= 14) {
      EXPECT_EQ(fault, DriveFault::protective_stop) << k;
      EXPECT_EQ(peers_.truths[k].tau, Vector::Zero(2)) << k;
    } else {
      EXPECT_EQ(fault, k > 10 ? DriveFault::command_missed : DriveFault::none) << k;
    }
  }
  // For 0.5 s, or until it stands still.
  const auto& begin = peers_.truths[14].v;
  const auto& end = peers_.truths.back().v;
  EXPECT_LE(peers_.truths.size(), 14u + 500u);
  // Damping is inertia over 0.1 s, so 0.5 s leave about exp(-5); the joints' coupling allows some
  // more. Without braking the arm would keep its energy.
  EXPECT_LT(end.norm(), 0.05 * begin.norm());
}

TEST_F(Stopping, TellsTheOthersAtOnceAndEndsWhenTheRobotIsAtRest) {
  peers_.on_measurement = [](std::int64_t) {};
  const Outcome outcome = run(s_, peers_);
  ASSERT_EQ(outcome.code, ExitCode::protective_stop);
  const auto told = std::ranges::find_if(
      peers_.heard_plant, [](const messages::Participant& each) { return !each.fault.empty(); });
  ASSERT_NE(told, peers_.heard_plant.end());
  EXPECT_EQ(told->state, messages::ParticipantState::running) << "it still has to brake";
  EXPECT_EQ(told->fault_code, 5);
  EXPECT_EQ(peers_.heard_plant.back().state, messages::ParticipantState::fault);
  EXPECT_EQ(peers_.heard_plant.back().fault, outcome.fault);
}

TEST_F(Stopping, StopsAtATorqueThatIsNotFinite) {
  peers_.on_measurement = [&](std::int64_t k) {
    if (k == 10) return peers_.non_finite_command(k, controllers_address);
    peers_.command(k, torque_of(k));
  };
  const Outcome outcome = run(s_, peers_);
  EXPECT_EQ(outcome.code, ExitCode::protective_stop);
  EXPECT_THAT(outcome.fault, HasSubstr("not finite for tick 10"));
  EXPECT_EQ(peers_.truths.back().fault, DriveFault::protective_stop);
}

TEST_F(Stopping, DropsAStrangersTorqueThatIsNotFinite) {
  const scenario::Scenario s = scenario({});
  Peers peers(s);
  peers.on_measurement = [&](std::int64_t k) {
    peers.non_finite_command(k, "a stranger's address");
    peers.command(k, torque_of(k));
  };
  const Outcome outcome = run(s, peers);
  EXPECT_EQ(outcome.fault, "");
  EXPECT_EQ(outcome.statistics.rejected.total(), 30);
}

TEST_F(Stopping, BrakesBeforeItEndsWhenTwoProcessesCommand) {
  peers_.on_measurement = [&](std::int64_t k) {
    peers_.command(k, torque_of(k));
    if (k == 10) peers_.command(k, torque_of(k + 1), "a second controller");
  };
  const Outcome outcome = run(s_, peers_);
  EXPECT_EQ(outcome.code, ExitCode::protocol_violated);
  EXPECT_THAT(outcome.fault, HasSubstr(controllers_address));
  EXPECT_THAT(outcome.fault, HasSubstr("a second controller"));
  EXPECT_EQ(peers_.truths.back().fault, DriveFault::protective_stop);
}

TEST_F(Stopping, SaysSoWhenThePlantItselfWasLate) {
  peers_.on_measurement = [&](std::int64_t k) {
    if (k < 10) peers_.command(k, Vector::Zero(2));
    if (k == 10) std::this_thread::sleep_for(8ms);
  };
  const Outcome outcome = run(s_, peers_);
  EXPECT_EQ(outcome.code, ExitCode::protective_stop);
  EXPECT_THAT(outcome.fault, HasSubstr("4 commands in a row"));
  EXPECT_THAT(outcome.fault, HasSubstr("The plant itself woke up to"));
  EXPECT_GE(outcome.statistics.plant().wake_up_jitter_us.max_us(), 6500);
}

TEST_F(Stopping, BrakesBeforeItEndsWhenInterrupted) {
  std::atomic<bool> interrupted = false;
  peers_.on_measurement = [&](std::int64_t k) {
    peers_.command(k, torque_of(k));
    if (k == 10) interrupted = true;
  };
  const Outcome outcome = run(s_, peers_, &interrupted);
  EXPECT_EQ(outcome.code, ExitCode::interrupted);
  EXPECT_EQ(peers_.truths.back().fault, DriveFault::protective_stop);
}

TEST(RealtimeStart, IsRefusedWhenACommandComesDuringTheRendezvous) {
  const scenario::Scenario s = scenario({});
  Peers peers(s);
  peers.on_first_announcement = [&] { peers.command(812, torque_of(1), "10.0.0.9:4000", 3); };
  const Outcome outcome = run(s, peers);
  EXPECT_EQ(outcome.code, ExitCode::protocol_violated);
  EXPECT_THAT(outcome.fault, HasSubstr("10.0.0.9:4000"));
  EXPECT_THAT(outcome.fault, HasSubstr("run 3"));
  EXPECT_TRUE(peers.truths.empty());
}

TEST(RealtimeStart, IsRefusedWhenACommandComesBeforeTheFirstTick) {
  const scenario::Scenario s = scenario({});
  Peers peers(s);
  peers.on_run_info = [&] { peers.command(0, torque_of(0)); };
  const Outcome outcome = run(s, peers);
  EXPECT_EQ(outcome.code, ExitCode::protocol_violated);
  EXPECT_THAT(outcome.fault, HasSubstr("before the start"));
  EXPECT_TRUE(peers.truths.empty());
}

TEST(RealtimeStart, IsNotStoppedByNoiseOnTheCommandChannel) {
  const scenario::Scenario s = scenario({});
  Peers peers(s);
  const std::vector<std::byte> noise(57, std::byte{0x5a});
  peers.on_first_announcement = [&] { peers.queue("ARM_COMMAND", noise, "10.0.0.9:4000"); };
  EXPECT_EQ(run(s, peers).fault, "");
}

TEST_F(Stopping, BrakesAnEmulatedRobotThatLeavesItsRange) {
  const scenario::Scenario s =
      with_limited_elbow(s_, R"(lower="-0.05" upper="2" effort="100" velocity="10")");
  Peers peers(s);
  peers.on_measurement = [&](std::int64_t k) { peers.command(k, Vector::Zero(2)); };
  const Outcome outcome = run(s, peers);
  EXPECT_EQ(outcome.code, ExitCode::protective_stop);
  EXPECT_THAT(outcome.fault, HasSubstr("joint 2 (elbow) is at -0.05"));
  // The stop is recorded from the tick outside to rest.
  const auto first =
      std::ranges::find_if(peers.truths, [](const messages::truth::PlantTruth& each) {
        return each.fault == DriveFault::protective_stop;
      });
  ASSERT_NE(first, peers.truths.end());
  EXPECT_LT(first->q[1], -0.05);
  EXPECT_LT(peers.truths.back().v.norm(), 0.05 * first->v.norm());
}

TEST_F(Stopping, GoesOnBeyondALimitWhereTheScenarioSaysSoAndCounts) {
  const scenario::Scenario s = with_limited_elbow(
      scenario({"plant.on_limit=warn", "plant.initial.velocity_rad_per_s=[0, -2]"}),
      R"(lower="-3" upper="2" effort="100" velocity="1.5")");
  Peers peers(s);
  peers.on_measurement = [&](std::int64_t k) { peers.command(k, Vector::Zero(2)); };
  const Outcome outcome = run(s, peers);
  EXPECT_EQ(outcome.fault, "");
  EXPECT_EQ(outcome.statistics.plant().beyond_limit_ticks, (std::vector<std::int64_t>{0, 30}));
}

TEST(RealtimeLoop, FlagsAndCountsSaturationPerJoint) {
  const scenario::Scenario s = scenario({"plant.drive.torque_limit_Nm=[4, 1000]"});
  Peers peers(s);
  const Outcome outcome = run(s, peers);
  ASSERT_EQ(outcome.fault, "");
  std::int64_t saturated = 0;
  for (const auto& truth : peers.truths) {
    EXPECT_LE(std::abs(truth.tau[0]), 4);
    EXPECT_FALSE(truth.saturated[1]);
    saturated += truth.saturated[0] ? 1 : 0;
  }
  // 1 + k/2 exceeds 4 from k = 7 on, which acts over ticks 8 to 29.
  EXPECT_EQ(saturated, 22);
  EXPECT_EQ(outcome.statistics.plant().saturated_ticks, (std::vector<std::int64_t>{22, 0}));
}

}  // namespace
}  // namespace tachless::plant
