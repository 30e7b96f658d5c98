// The plant on the wall clock against peers that answer at once, or as a test wants it: what it
// makes of commands does not depend on how busy the machine is.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <functional>
#include <limits>
#include <list>
#include <map>
#include <string>
#include <thread>
#include <vector>

#include "app/session.h"
#include "bus/truth/truth_wire.h"
#include "bus/wire.h"
#include "plant/node.h"

namespace plant {
namespace {

using namespace std::chrono_literals;
using app::ExitCode;
using bus::Clock;
using bus::Role;
using bus::truth::DriveFault;
using testing::HasSubstr;

constexpr auto controllers_address = "controller's address";

app::Scenario scenario(std::vector<std::string> overrides) {
  overrides.insert(overrides.begin(),
                   {"loop.mode=realtime", "loop.duration_s=0.03", "robot.gravity_m_per_s2=0",
                    "plant.encoder.resolution_bits=null"});
  return app::load_scenario(std::string(TACHLESS_SOURCE_DIR) + "/scenarios/practical_rigid.yaml",
                            overrides);
}

/// A torque that tells its tick.
robot::Vector torque_of(std::int64_t tick) {
  robot::Vector tau(2);
  tau << 1 + 0.5 * static_cast<double>(tick), -0.25 * static_cast<double>(tick);
  return tau;
}

/// Reference, controller and logger as the plant sees them, on a bus of their own.
class Peers : public bus::Transport {
 public:
  explicit Peers(const app::Scenario& scenario) : digest_(scenario.digest) {
    // The controller answers at once, until a test says otherwise.
    on_measurement = [this](std::int64_t tick) { command(tick, torque_of(tick)); };
  }

  std::function<void(std::int64_t tick)> on_measurement;
  std::function<void()> on_run_info = [] {};
  std::function<void()> on_first_announcement = [] {};

  std::vector<bus::truth::PlantTruth> truths;
  std::vector<std::int64_t> truth_ticks, ticks, tick_utimes;
  std::vector<bus::Participant> heard_plant;

  void command(std::int64_t tick, const robot::Vector& tau,
               std::string sender = controllers_address, std::int64_t run = 0) {
    bus::Codec<robot::TorqueCommand> codec(layout_);
    queue("ARM_COMMAND", codec.encode({0, run != 0 ? run : run_, tick}, {tau}), std::move(sender));
  }
  /// The same with NaN for the last torque.
  void non_finite_command(std::int64_t tick, std::string sender) {
    bus::Codec<robot::TorqueCommand> codec(layout_);
    const auto sound = codec.encode({0, run_, tick}, {torque_of(tick)});
    std::vector<std::byte> bytes(sound.begin(), sound.end());
    std::fill(bytes.end() - 8, bytes.end(), std::byte{0xff});
    queue("ARM_COMMAND", bytes, std::move(sender));
  }
  void queue(std::string channel, std::span<const std::byte> bytes, std::string sender) {
    messages_.push_back({std::move(channel), {bytes.begin(), bytes.end()}, std::move(sender)});
  }

  void subscribe(const std::string& /*channel*/) override {}

  void publish(std::string_view channel, std::span<const std::byte> payload) override {
    bus::Stamp stamp;
    if (channel == "ARM_PARTICIPANT") {
      bus::Participant plant;
      ASSERT_EQ(participants_.decode(payload, stamp, plant), bus::Rejection::none);
      run_ = stamp.run;
      if (heard_plant.empty()) on_first_announcement();
      heard_plant.push_back(plant);
      for (const Role role : {Role::reference, Role::controller, Role::logger}) announce(role);
    } else if (channel == "ARM_RUN_INFO") {
      on_run_info();
      bus::Codec<bus::LogAck> codec(layout_);
      queue("ARM_LOG_ACK", codec.encode({0, run_, -1}, {}), "logger's address");
    } else if (channel == "ARM_POSITION") {
      robot::PositionMeasurement measurement;
      ASSERT_EQ(positions_.decode(payload, stamp, measurement), bus::Rejection::none);
      on_measurement(stamp.tick);
    } else if (channel == "ARM_TICK") {
      bus::Tick tick;
      ASSERT_EQ(ticks_.decode(payload, stamp, tick), bus::Rejection::none);
      ticks.push_back(stamp.tick);
      tick_utimes.push_back(stamp.utime);
    } else if (channel == "ARM_TRUTH") {
      truths.emplace_back();
      ASSERT_EQ(truths_.decode(payload, stamp, truths.back()), bus::Rejection::none);
      truth_ticks.push_back(stamp.tick);
    }
  }

  std::optional<bus::Datagram> receive(Clock::time_point deadline) override {
    if (messages_.empty()) {
      std::this_thread::sleep_until(deadline);
      return std::nullopt;
    }
    current_ = std::move(messages_.front());
    messages_.pop_front();
    return bus::Datagram{current_.channel, current_.payload, current_.sender};
  }

 private:
  struct Message {
    std::string channel;
    std::vector<std::byte> payload;
    std::string sender;
  };

  void announce(Role role) {
    bus::Participant self;
    self.instance = 100 + static_cast<int>(role);
    self.scenario_digest = digest_;
    const auto plants = heard_plant.back().state;
    self.state = plants == bus::ParticipantState::finished ? plants : bus::ParticipantState::ready;
    self.role = role;
    if (role == Role::controller) self.measurement = "POSITION";
    queue("ARM_PARTICIPANT", participants_.encode({0, run_, -1}, self),
          std::string(bus::name(role)) + "'s address");
  }

  std::int64_t digest_;
  std::int64_t run_ = 0;
  bus::Layout layout_{.num_joints = 2, .num_motors = 0, .num_filters = 0};
  bus::Codec<bus::Participant> participants_{layout_};
  bus::Codec<robot::PositionMeasurement> positions_{layout_};
  bus::Codec<bus::Tick> ticks_{layout_};
  bus::Codec<bus::truth::PlantTruth> truths_{layout_};
  std::list<Message> messages_;
  Message current_;
};

struct Outcome {
  ExitCode code = ExitCode::done;
  std::string fault;
  app::Statistics statistics;
};

Outcome run(const app::Scenario& scenario, Peers& peers,
            const std::atomic<bool>* interrupted = nullptr) {
  app::Session session(
      scenario, peers,
      {.role = Role::plant, .run_id = 7, .wait_s = 10, .interrupted = interrupted, .instance = 1});
  Outcome outcome;
  try {
    session.play([&] { run_node(scenario, peers, session); });
  } catch (const app::Failure& failure) {
    outcome.code = failure.code();
    outcome.fault = failure.what();
  }
  outcome.statistics = session.statistics();
  return outcome;
}

std::vector<double> first_torques(const Peers& peers) {
  std::vector<double> result;
  for (const auto& truth : peers.truths) result.push_back(truth.tau[0]);
  return result;
}

TEST(RealtimeLoop, AppliesEachCommandOverTheNextTickAndNothingOverTheFirst) {
  const app::Scenario s = scenario({});
  ASSERT_EQ(s.loop.command_delay, 1);
  Peers peers(s);
  const Outcome outcome = run(s, peers);
  ASSERT_EQ(outcome.fault, "");
  ASSERT_EQ(peers.truths.size(), 30u);
  EXPECT_EQ(peers.truths[0].tau, robot::Vector::Zero(2));
  for (std::size_t k = 1; k < 30; ++k) {
    EXPECT_EQ(peers.truths[k].tau, torque_of(static_cast<std::int64_t>(k) - 1)) << k;
    EXPECT_EQ(peers.truths[k].fault, DriveFault::none) << k;
  }
  EXPECT_EQ(outcome.statistics.missed_commands, 0);
  EXPECT_EQ(outcome.statistics.command_age.count(), 30);
  EXPECT_EQ(outcome.statistics.wake_up_jitter.count(), 30);
}

TEST(RealtimeLoop, DelayShiftsTheTorquesByExactlyOneTick) {
  const app::Scenario late = scenario({});
  const app::Scenario prompt = scenario({"loop.command_delay=0"});
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
    const app::Scenario s = scenario({"loop.command_delay=" + std::to_string(delay)});
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
    EXPECT_EQ(outcome.statistics.missed_commands, 3);
    EXPECT_EQ(outcome.statistics.longest_command_miss, 3);
  }
}

TEST(RealtimeLoop, CountsALateCommandAndDoesNotApplyIt) {
  const app::Scenario s = scenario({});
  Peers peers(s);
  peers.on_measurement = [&](std::int64_t k) {
    if (k == 6) peers.command(5, torque_of(5));
    if (k != 5) peers.command(k, torque_of(k));
  };
  const Outcome outcome = run(s, peers);
  ASSERT_EQ(outcome.fault, "");
  EXPECT_EQ(outcome.statistics.late_commands, 1);
  EXPECT_EQ(outcome.statistics.missed_commands, 1);
  EXPECT_EQ(peers.truths[6].tau, torque_of(4));
  EXPECT_EQ(peers.truths[7].tau, torque_of(6));
}

TEST(RealtimeLoop, IgnoresACommandOfATickThatHasNotBegun) {
  const app::Scenario s = scenario({});
  Peers peers(s);
  peers.on_measurement = [&](std::int64_t k) {
    peers.command(k + 1, robot::Vector::Constant(2, 1e6));
    peers.command(k, torque_of(k));
  };
  const Outcome outcome = run(s, peers);
  ASSERT_EQ(outcome.fault, "");
  EXPECT_EQ(outcome.statistics.rejected.total(), 30);
  EXPECT_EQ(peers.truths[9].tau, torque_of(8));
}

TEST(RealtimeLoop, BeginsNoTickBeforeItsDeadlineAndNumbersThemAll) {
  const app::Scenario s = scenario({});
  Peers peers(s);
  ASSERT_EQ(run(s, peers).fault, "");
  ASSERT_EQ(peers.ticks.size(), 30u);
  for (std::int64_t k = 0; k < 30; ++k) {
    EXPECT_EQ(peers.ticks[static_cast<std::size_t>(k)], k);
    EXPECT_GE(peers.tick_utimes[static_cast<std::size_t>(k)], 1000 * k);
  }
}

TEST(RealtimeLoop, CountsDeadlinesItMissesAndLosesNoTickOverThem) {
  const app::Scenario s = scenario({});
  Peers peers(s);
  peers.on_measurement = [&](std::int64_t k) {
    peers.command(k, torque_of(k));
    if (k == 10) std::this_thread::sleep_for(5500us);  // into tick 15
  };
  const Outcome outcome = run(s, peers);
  ASSERT_EQ(outcome.fault, "");
  EXPECT_EQ(peers.truths.size(), 30u);
  // Ticks 11 to 14 begin later than one period after their deadlines.
  EXPECT_GE(outcome.statistics.missed_deadlines, 4);
  EXPECT_GE(outcome.statistics.longest_miss, 4);
  EXPECT_GE(outcome.statistics.wake_up_jitter.max_us(), 4000);
  EXPECT_EQ(peers.truths[29].tau, torque_of(28));
}

class Stopping : public testing::Test {
 protected:
  const app::Scenario s_ = scenario(
      {"loop.duration_s=2", "loop.max_missed=3", "plant.initial.velocity_rad_per_s=[1.5, -2]"});
  Peers peers_{s_};
};

TEST_F(Stopping, BrakesViscouslyWhenTooManyCommandsAreMissed) {
  peers_.on_measurement = [&](std::int64_t k) {
    if (k < 10) peers_.command(k, robot::Vector::Zero(2));
  };
  const Outcome outcome = run(s_, peers_);
  EXPECT_EQ(outcome.code, ExitCode::protective_stop);
  EXPECT_THAT(outcome.fault, HasSubstr("4 commands in a row"));
  EXPECT_THAT(outcome.fault, HasSubstr("loop.max_missed: 3"));
  EXPECT_EQ(outcome.statistics.longest_command_miss, 4);

  // Ticks 10 to 13 go without; 14 is the first that is braked.
  ASSERT_GT(peers_.truths.size(), 20u);
  for (std::size_t k = 0; k < peers_.truths.size(); ++k) {
    EXPECT_EQ(peers_.truth_ticks[k], static_cast<std::int64_t>(k));
    const auto fault = peers_.truths[k].fault;
    if (k >= 14) {
      EXPECT_EQ(fault, DriveFault::protective_stop) << k;
      EXPECT_EQ(peers_.truths[k].tau, robot::Vector::Zero(2)) << k;
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
      peers_.heard_plant, [](const bus::Participant& each) { return !each.fault.empty(); });
  ASSERT_NE(told, peers_.heard_plant.end());
  EXPECT_EQ(told->state, bus::ParticipantState::running) << "it still has to brake";
  EXPECT_EQ(told->fault_code, 5);
  EXPECT_EQ(peers_.heard_plant.back().state, bus::ParticipantState::fault);
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
  const app::Scenario s = scenario({});
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
  const app::Scenario s = scenario({});
  Peers peers(s);
  peers.on_first_announcement = [&] { peers.command(812, torque_of(1), "10.0.0.9:4000", 3); };
  const Outcome outcome = run(s, peers);
  EXPECT_EQ(outcome.code, ExitCode::protocol_violated);
  EXPECT_THAT(outcome.fault, HasSubstr("10.0.0.9:4000"));
  EXPECT_THAT(outcome.fault, HasSubstr("run 3"));
  EXPECT_TRUE(peers.truths.empty());
}

TEST(RealtimeStart, IsRefusedWhenACommandComesBeforeTheFirstTick) {
  const app::Scenario s = scenario({});
  Peers peers(s);
  peers.on_run_info = [&] { peers.command(0, torque_of(0)); };
  const Outcome outcome = run(s, peers);
  EXPECT_EQ(outcome.code, ExitCode::protocol_violated);
  EXPECT_THAT(outcome.fault, HasSubstr("before the start"));
  EXPECT_TRUE(peers.truths.empty());
}

TEST(RealtimeStart, IsNotStoppedByNoiseOnTheCommandChannel) {
  const app::Scenario s = scenario({});
  Peers peers(s);
  const std::vector<std::byte> noise(57, std::byte{0x5a});
  peers.on_first_announcement = [&] { peers.queue("ARM_COMMAND", noise, "10.0.0.9:4000"); };
  EXPECT_EQ(run(s, peers).fault, "");
}

TEST(RealtimeLoop, FlagsAndCountsSaturationPerJoint) {
  const app::Scenario s = scenario({"plant.drive.torque_limit_Nm=[4, 1000]"});
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
  EXPECT_EQ(outcome.statistics.saturated_ticks, (std::vector<std::int64_t>{22, 0}));
}

}  // namespace
}  // namespace plant
