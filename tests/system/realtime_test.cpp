// These tests run whole loops on the wall clock. The robot is at rest and shall stay there. Any
// number of commands may be missed, unless a test says otherwise. The checks do not depend on the
// load of the machine.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <map>
#include <set>
#include <thread>

#include "bus/udp_transport.h"
#include "logger/run_log.h"
#include "tests/support/counting_new.h"
#include "tests/support/private_network.h"
#include "tests/system/four_threads.h"
#include "tests/system/wrapped.h"

namespace tachless::system_test {
namespace {

using namespace std::chrono_literals;
using base::Clock;
using base::ExitCode;
using messages::Role;
using messages::truth::DriveFault;
using testing::HasSubstr;

scenario::Scenario at_rest(std::vector<std::string> overrides) {
  const std::vector<std::string> always = {"loop.mode=realtime",
                                           "loop.duration_s=0.3",
                                           "loop.max_missed=1000000",
                                           "robot.gravity_m_per_s2=0",
                                           "plant.encoder.resolution_bits=null",
                                           "reference={hold: {position_rad: [0, 0]}}"};
  overrides.insert(overrides.begin(), always.begin(), always.end());
  return scenario("practical_rigid", overrides);
}

struct Recorded {
  std::vector<logger::TickRecord> ticks;
  logger::RunSummary summary;
};

Recorded recorded_by(const FourThreads& threads) {
  Recorded result;
  logger::RunLog log = logger::RunLog::open(threads.log_path());
  logger::TickRecord record;
  while (log.next(record)) result.ticks.push_back(record);
  result.summary = log.summary();
  return result;
}

TEST(RealtimeRun, RecordsEveryMessageOnceInOrderOfArrival) {
  FourThreads threads(at_rest({}));
  const RunResult result = threads.finish();
  ASSERT_EQ(result.complaints(), "");

  logger::LogReader log(threads.log_path());
  std::set<std::pair<std::string, std::int64_t>> seen;
  std::int64_t participants = 0;
  std::int64_t utime = 0;
  bool first = true;
  while (const auto event = log.next()) {
    EXPECT_EQ(event->channel == "ARM_RUN_INFO", first) << "it comes first and once";
    first = false;
    EXPECT_GE(event->utime, utime);
    utime = event->utime;
    if (event->channel == "ARM_PARTICIPANT") {
      ++participants;
      continue;
    }
    const messages::Stamp stamp = messages::stamp_of(event->data);
    EXPECT_TRUE(seen.insert({std::string(event->channel), stamp.tick}).second)
        << event->channel << " " << stamp.tick;
  }
  EXPECT_GE(participants, 4);
  // The time runs from the first tick to the last, and has little of the time before.
  EXPECT_GE(utime, 299'000);
  for (std::int64_t k = 0; k < 300; ++k) {
    for (const auto* channel : {"ARM_TICK", "ARM_POSITION", "ARM_REFERENCE", "ARM_TRUTH"}) {
      EXPECT_TRUE(seen.contains({channel, k})) << channel << " " << k;
    }
  }
  const session::Statistics& logger = result.of.at(Role::logger).statistics;
  const session::Statistics& controller = result.of.at(Role::controller).statistics;
  EXPECT_EQ(logger.logger().log.ticks + logger.logger().log.gaps, 300);
  // This network loses nothing. Only ticks that a busy controller skipped are missing.
  EXPECT_EQ(logger.logger().log.gaps, controller.controller().skipped_ticks);
}

TEST(RealtimeRun, TruthTellsWhatBecameOfEachCommand) {
  FourThreads threads(at_rest({"plant.initial.position_rad=[0.001, 0]"}));
  const RunResult result = threads.finish();
  ASSERT_EQ(result.complaints(), "");
  const Recorded log = recorded_by(threads);
  ASSERT_EQ(log.ticks.size(), 300u);
  ASSERT_EQ(log.ticks[0].truth->tau, Vector::Zero(2));
  std::int64_t held = 0;
  for (std::size_t k = 1; k < 300; ++k) {
    const auto& truth = *log.ticks[k].truth;
    if (truth.fault == DriveFault::none) {
      EXPECT_EQ(truth.tau, log.ticks[k - 1].command->tau) << k;
    } else {
      EXPECT_EQ(truth.fault, DriveFault::command_missed);
      EXPECT_EQ(truth.tau, log.ticks[k - 1].truth->tau) << k;
      ++held;
    }
  }
  const auto missed = result.of.at(Role::plant).statistics.plant().missed_commands;
  EXPECT_TRUE(missed == held || missed == held + 1) << "the last tick's acts over no tick";
}

TEST(RealtimeRun, GoesOnUnderLossAndSaysWhatIsMissing) {
  FourThreads threads(at_rest({"loop.duration_s=0.5"}), {.loss = 0.05, .seed = 3});
  const RunResult result = threads.finish();
  ASSERT_EQ(result.complaints(), "");
  const session::Statistics& plant = result.of.at(Role::plant).statistics;
  const session::Statistics& controller = result.of.at(Role::controller).statistics;
  const session::Statistics& logger = result.of.at(Role::logger).statistics;
  EXPECT_EQ(plant.ticks, 500);
  EXPECT_GT(plant.plant().missed_commands, 0);
  EXPECT_GT(controller.controller().gaps, 0);
  EXPECT_GE(controller.controller().skipped_ticks, controller.controller().gaps);
  EXPECT_GT(logger.logger().log.gaps, 0);
  EXPECT_EQ(logger.logger().log.ticks + logger.logger().log.gaps, 500);
  const Recorded log = recorded_by(threads);
  EXPECT_GT(log.summary.of(messages::Slot::command).missing.count, 0u);
}

TEST(RealtimeRun, EndsInAProtectiveStopWhenTheControllerDies) {
  FourThreads threads(at_rest({"loop.duration_s=60", "loop.max_missed=20", "loop.give_up_s=2",
                               "plant.initial.velocity_rad_per_s=[0.1, 0.1]"}));
  threads.wrap([](Role role, std::unique_ptr<bus::Transport> inner) {
    if (role != Role::controller) return inner;
    return std::unique_ptr<bus::Transport>(new Mortal(std::move(inner), 60));
  });
  const RunResult result = threads.finish();
  for (const Role role : {Role::plant, Role::reference, Role::logger}) {
    EXPECT_EQ(result.of.at(role).code, ExitCode::protective_stop) << messages::name(role);
    EXPECT_THAT(result.of.at(role).fault, HasSubstr("21 commands in a row"));
  }
  EXPECT_EQ(result.of.at(Role::controller).code, ExitCode::peer_lost);

  const Recorded log = recorded_by(threads);
  const auto last = std::find_if(log.ticks.rbegin(), log.ticks.rend(),
                                 [](const logger::TickRecord& each) { return each.truth; });
  ASSERT_NE(last, log.ticks.rend());
  EXPECT_EQ(last->truth->fault, DriveFault::protective_stop);
  EXPECT_EQ(last->truth->tau, Vector::Zero(2));
  // The drives brake for some tenths of a second, so a good part is in the log.
  const auto braked = std::ranges::count_if(log.ticks, [](const logger::TickRecord& each) {
    return each.truth && each.truth->fault == DriveFault::protective_stop;
  });
  EXPECT_GT(braked, 1);
  ASSERT_FALSE(log.summary.faults.empty());
  EXPECT_THAT(log.summary.faults.front().text, HasSubstr("21 commands in a row"));
}

/// Expects that the log has all between the first and the last tick whose drives braked.
void expect_stop_recorded(const Recorded& log, const Outcome& plant) {
  ASSERT_FALSE(log.ticks.empty());
  const auto stops = std::ranges::count_if(log.ticks, [](const logger::TickRecord& each) {
    return each.truth && each.truth->fault == DriveFault::protective_stop;
  });
  EXPECT_GT(stops, 1);
  ASSERT_TRUE(log.ticks.back().truth);
  EXPECT_EQ(log.ticks.back().truth->fault, DriveFault::protective_stop);
  EXPECT_EQ(log.ticks.back().tick, plant.statistics.ticks - 1) << "the stop is recorded to its end";
  // Nobody answers while the robot comes to rest. At most a tick at its beginning is incomplete.
  const std::uint64_t lost = plant.statistics.plant().missed_commands;
  for (const auto slot : {messages::Slot::command, messages::Slot::controller_state}) {
    EXPECT_LE(log.summary.of(slot).missing.count, lost + 1);
  }
}

/// Answers each message of `channel` with the same, except for its last number, as a stranger.
void contradict(bus::Transport& bus, const std::string& channel, const std::atomic<bool>& stop) {
  bus.subscribe(channel);
  while (!stop) {
    const auto heard = bus.receive(Clock::now() + 1ms);
    if (!heard || messages::stamp_of(heard->payload).tick < 50) continue;
    std::vector<std::byte> other(heard->payload.begin(), heard->payload.end());
    other[channel == "ARM_COMMAND" ? other.size() - 1 : other.size() - 8 - 3] ^= std::byte{1};
    bus.publish(channel, other);
  }
}

TEST(AProtectiveStop, IsInTheLogWhoeverNoticesFirstThatTwoCommand) {
  // Only the logger knows of a conflict in TRUTH.
  for (const std::string channel : {"ARM_COMMAND", "ARM_TRUTH"}) {
    SCOPED_TRACE(channel);
    FourThreads threads(
        at_rest({"loop.duration_s=60", "plant.initial.velocity_rad_per_s=[0.1, 0.1]"}));
    const auto stranger = threads.network().connect("a stranger");
    std::atomic<bool> stop = false;
    std::thread rival([&] { contradict(*stranger, channel, stop); });
    const RunResult result = threads.finish();
    stop = true;
    rival.join();
    for (const Role role : all_roles) {
      EXPECT_EQ(result.of.at(role).code, ExitCode::protocol_violated) << messages::name(role);
    }
    const Recorded log = recorded_by(threads);
    expect_stop_recorded(log, result.of.at(Role::plant));
    EXPECT_GT(
        log.summary.of(channel == "ARM_TRUTH" ? messages::Slot::truth : messages::Slot::command)
            .conflicts,
        0u);
    ASSERT_FALSE(log.summary.faults.empty());
    EXPECT_THAT(log.summary.faults.back().text, HasSubstr("a stranger"));
  }
}

TEST(AProtectiveStop, IsInTheLogWhenTheLoggerIsInterrupted) {
  FourThreads threads(
      at_rest({"loop.duration_s=60", "plant.initial.velocity_rad_per_s=[0.1, 0.1]"}));
  const auto listener = threads.network().connect("listener");
  listener->subscribe("ARM_COMMAND");
  for (const Role role : all_roles) threads.start(role);
  for (int i = 0; i < 100; ++i) ASSERT_TRUE(listener->receive(Clock::now() + 60s));
  threads.interrupt(Role::logger);
  const RunResult result = threads.finish();
  EXPECT_EQ(result.of.at(Role::logger).code, ExitCode::interrupted);
  EXPECT_EQ(result.of.at(Role::plant).code, ExitCode::peer_lost);
  const Recorded log = recorded_by(threads);
  expect_stop_recorded(log, result.of.at(Role::plant));
  EXPECT_EQ(log.summary.faults.back().text, "interrupted");
}

TEST(RealtimeRun, EndsWhenTheLoggerDiesThoughSomebodyRepeatsWhatItHasAnnounced) {
  FourThreads threads(at_rest({"loop.duration_s=60", "loop.give_up_s=1"}));
  threads.wrap([](Role role, std::unique_ptr<bus::Transport> inner) {
    if (role != Role::logger) return inner;
    return std::unique_ptr<bus::Transport>(new Mortal(std::move(inner), 10));
  });
  const auto stranger = threads.network().connect("a stranger");
  stranger->subscribe("ARM_PARTICIPANT");
  std::atomic<bool> stop = false;
  std::thread repeater([&] {
    std::vector<std::vector<std::byte>> said;
    while (!stop) {
      const auto heard = stranger->receive(Clock::now() + 5ms);
      if (heard && heard->sender == "logger's endpoint") {
        said.emplace_back(heard->payload.begin(), heard->payload.end());
      }
      for (const auto& each : said) stranger->publish("ARM_PARTICIPANT", each);
    }
  });
  const RunResult result = threads.finish();
  stop = true;
  repeater.join();
  EXPECT_EQ(result.of.at(Role::plant).code, ExitCode::peer_lost);
  EXPECT_THAT(result.of.at(Role::plant).fault, HasSubstr("has been silent for 1 s"));
  // Its death takes half a second, then come one second and half a second of braking. The rest is
  // for a busy machine.
  EXPECT_LT(result.of.at(Role::plant).statistics.ticks, 5'000);
}

/// Puts a node on the real bus.
Wrapper on_the_network(const std::string& url) {
  return [url](Role, std::unique_ptr<bus::Transport>) {
    return std::unique_ptr<bus::Transport>(new bus::UdpTransport(bus::parse_lcm_url(url)));
  };
}

constexpr auto counting_url = "udpm://239.255.76.67:7704?ttl=0";

/// A counter of a node's allocations from its fifth message on `channel` to its last. It leaves out
/// the time between a message on `not_after` and the next call of the bus.
class Counting : public Wrapped {
 public:
  struct Count {
    std::int64_t messages = 0;
    std::size_t allocated = 0;
  };

  Counting(std::string channel, std::string not_after, Count& count)
      : Wrapped(std::make_unique<bus::UdpTransport>(bus::parse_lcm_url(counting_url))),
        channel_(std::move(channel)),
        not_after_(std::move(not_after)),
        count_(count) {}

  void publish(std::string_view channel, std::span<const std::byte> payload) override {
    const bool is_one = channel == channel_;
    note();
    Wrapped::publish(channel, payload);
    excused_ = channel == not_after_;
    if (is_one) {
      count_.allocated += pending_;
      if (++count_.messages <= 5) count_.allocated = 0;
      pending_ = 0;
    }
    last_ = allocations;
  }
  std::optional<bus::Datagram> receive(Clock::time_point deadline) override {
    note();
    auto datagram = Wrapped::receive(deadline);
    pending_ += allocations - last_;
    last_ = allocations;
    return datagram;
  }

 private:
  void note() {
    if (!excused_) pending_ += allocations - last_;
    excused_ = false;
    last_ = allocations;
  }

  std::string channel_;
  std::string not_after_;
  Count& count_;
  std::size_t last_ = 0;
  std::size_t pending_ = 0;
  bool excused_ = false;
};

class ARealtimeRun : public testing::TestWithParam<bool> {};

TEST_P(ARealtimeRun, AllocatesNothingAfterTheFirstTicks) {
  FourThreads threads(at_rest({"loop.duration_s=1"}));
  if (GetParam()) threads.give_key({});
  // The logger is no part of the loop.
  const std::map<Role, std::string> channels = {{Role::plant, "ARM_TICK"},
                                                {Role::reference, "ARM_REFERENCE"},
                                                {Role::controller, "ARM_COMMAND"}};
  std::map<Role, Counting::Count> counts;
  for (const auto& [role, channel] : channels) counts[role];
  threads.wrap([&](Role role, std::unique_ptr<bus::Transport> inner) {
    if (!channels.contains(role)) return on_the_network(counting_url)(role, std::move(inner));
    // The plant integrates after its TRUTH, and Simbody's integrators allocate.
    return std::unique_ptr<bus::Transport>(
        new Counting(channels.at(role), role == Role::plant ? "ARM_TRUTH" : "", counts.at(role)));
  });
  ASSERT_EQ(threads.finish().complaints(), "");
  for (const auto& [role, count] : counts) {
    EXPECT_EQ(count.allocated, 0u) << messages::name(role);
    EXPECT_GT(count.messages, 500) << messages::name(role);
  }
}

INSTANTIATE_TEST_SUITE_P(OnABus, ARealtimeRun, testing::Bool(), [](const auto& key) {
  return std::string(key.param ? "WithAKey" : "WithoutAKey");
});

}  // namespace
}  // namespace tachless::system_test
