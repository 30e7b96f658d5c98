// The four real nodes in four threads: the same log whatever the network does, and clean ends.
#include <fmt/core.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <fstream>
#include <map>
#include <optional>
#include <random>
#include <thread>

#include "controller/registry.h"
#include "in_process/in_process_loop.h"
#include "logger/log_file.h"
#include "logger/run_log.h"
#include "messages/truth/truth_wire.h"
#include "session/tick_master.h"
#include "tests/support/in_process_log.h"
#include "tests/support/law_examples.h"
#include "tests/support/limited_elbow.h"
#include "tests/support/rough_plant.h"
#include "tests/system/four_threads.h"
#include "tests/system/wrapped.h"

namespace tachless::system_test {
namespace {

using namespace std::chrono_literals;
using base::Clock;
using base::ExitCode;
using messages::Role;
using testing::AnyOf;
using testing::HasSubstr;

scenario::Scenario short_run() { return scenario("paper_rigid", {"loop.duration_s=0.015"}); }

messages::Layout layout(const scenario::Scenario& scenario) {
  return messages::layout(scenario.num_joints, scenario.robot.flexible.has_value(), 2);
}

const std::string& clean_log() {
  static const std::string log = [] {
    const RunResult result = run(short_run());
    EXPECT_EQ(result.complaints(), "");
    return result.log;
  }();
  return log;
}

/// The last event of the log, in words, if it is a fault.
std::string end_of(const FourThreads& threads) {
  logger::LogReader log(threads.log_path());
  std::string end;
  const messages::Codec<messages::Participant> codec(messages::Layout{});
  while (const auto event = log.next()) {
    messages::Stamp stamp;
    messages::Participant who;
    const bool fault = event->channel == "ARM_PARTICIPANT" &&
                       codec.decode(event->data, stamp, who) == messages::Rejection::none &&
                       who.state == messages::ParticipantState::fault;
    end = fault ? fmt::format("the {}: {}", messages::name(who.role), who.fault) : "";
  }
  return end;
}

/// A thread of a test that listens or makes trouble until it is stopped.
class Bystander {
 public:
  explicit Bystander(std::function<void(const std::atomic<bool>& stop)> act)
      : thread_([this, act = std::move(act)] { act(stop_); }) {}
  ~Bystander() {
    stop_ = true;
    thread_.join();
  }

 private:
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

TEST(TheLoop, RecordsRunInfoAndThenSixMessagesATickInOrder) {
  const scenario::Scenario scenario = short_run();
  ASSERT_EQ(scenario.loop.num_ticks, 300);
  FourThreads threads(scenario);
  const RunResult result = threads.finish();
  ASSERT_EQ(result.complaints(), "");
  logger::LogReader log(threads.log_path());
  const auto run_info = log.next();
  ASSERT_TRUE(run_info);
  EXPECT_EQ(run_info->channel, "ARM_RUN_INFO");
  for (std::int64_t k = 0; k < 300; ++k) {
    for (const auto* channel : {"ARM_TICK", "ARM_POSITION", "ARM_REFERENCE", "ARM_COMMAND",
                                "ARM_CONTROLLER_STATE", "ARM_TRUTH"}) {
      const auto event = log.next();
      ASSERT_TRUE(event);
      EXPECT_EQ(event->channel, channel) << k;
      EXPECT_EQ(event->utime, 50 * k);
    }
  }
  EXPECT_FALSE(log.next());
  for (const Role role : all_roles) EXPECT_EQ(result.of.at(role).statistics.ticks, 300);
}

TEST(TheLoop, CommandsWhatTheInProcessLoopCommandsToTheLastBitUnderEveryLaw) {
  std::vector<std::string_view> seen;
  for (const support::LawExample& example : support::law_examples()) {
    SCOPED_TRACE(example.law);
    seen.push_back(example.law);
    const double period_s = scenario(example.scenario, {}).loop.period_s;
    std::vector<std::string> overrides = example.overrides();
    overrides.push_back("loop.duration_s=" + std::to_string(100 * period_s));
    const scenario::Scenario scenario = system_test::scenario(example.scenario, overrides);
    FourThreads threads(scenario, {.loss = 0.1, .seed = 4});
    ASSERT_EQ(threads.finish().complaints(), "");

    logger::LogReader log(threads.log_path());
    std::vector<std::vector<std::byte>> recorded;
    while (const auto event = log.next()) {
      if (event->channel.ends_with("_COMMAND")) {
        recorded.emplace_back(event->data.begin(), event->data.end());
      }
    }
    messages::Codec<messages::TorqueCommand> codec(layout(scenario));
    std::int64_t ticks = 0;
    in_process::run_in_process(scenario, [&](const in_process::TickRecord& tick) {
      messages::Stamp stamp;
      messages::TorqueCommand command;
      const auto& bytes = recorded.at(static_cast<std::size_t>(tick.tick));
      EXPECT_EQ(codec.decode(bytes, stamp, command), messages::Rejection::none);
      EXPECT_EQ(stamp.tick, tick.tick);
      EXPECT_TRUE(command.tau == tick.command.tau) << tick.tick;
      ++ticks;
      return true;
    });
    EXPECT_EQ(ticks, scenario.loop.num_ticks);
    EXPECT_EQ(recorded.size(), static_cast<std::size_t>(ticks));
  }
  EXPECT_THAT(seen, testing::UnorderedElementsAreArray(controller::law_names()));
}

TEST(TheLoop, LogsWhatTheInProcessLoopLogsAndReplaysWhateverThePlantSuffers) {
  for (const bool friction : {false, true}) {
    SCOPED_TRACE(friction);
    std::vector<std::string> overrides = support::rough_plant(friction);
    overrides.push_back("loop.duration_s=0.2");
    const scenario::Scenario scenario = system_test::scenario("practical_rigid", overrides);
    FourThreads threads(scenario, {.loss = 0.1, .seed = 5});
    ASSERT_EQ(threads.finish().complaints(), "");

    logger::RunLog log = logger::RunLog::open(threads.log_path());
    logger::LogReader recorded(threads.log_path());
    for (const logger::Recorded& expected : support::in_process_log(scenario, log.run())) {
      const auto event = recorded.next();
      ASSERT_TRUE(event);
      EXPECT_EQ(event->channel, expected.channel);
      const std::string data(reinterpret_cast<const char*>(event->data.data()), event->data.size());
      EXPECT_TRUE(data == expected.data) << event->channel << " at " << event->utime << " us";
    }
    EXPECT_FALSE(recorded.next());
  }
}

/// The elbow goes to -0.3 rad, faster than this on its way.
constexpr const char* slow = R"(lower="-1" upper="2" effort="1e5" velocity="0.5")";

TEST(TheLoop, EndsAtALimitOfTheRobotForAllFourAndTheLogSaysWhy) {
  FourThreads threads(with_limited_elbow(scenario("regulation", {}), slow));
  const RunResult result = threads.finish();
  const Outcome& plant = result.of.at(Role::plant);
  EXPECT_EQ(plant.code, ExitCode::protective_stop);
  EXPECT_THAT(plant.fault, HasSubstr("joint 2 (elbow) moves at -"));
  EXPECT_THAT(plant.fault, HasSubstr("faster than its limit of 0.5 rad/s"));
  for (const Role role : all_roles) EXPECT_NE(result.of.at(role).code, ExitCode::done);
  EXPECT_THAT(end_of(threads), HasSubstr("the plant: joint 2 (elbow) moves at"));
}

TEST(TheLoop, CommandsTheSameBeyondALimitWhereTheScenarioSaysSo) {
  const scenario::Scenario free =
      scenario("regulation", {"plant.on_limit=warn", "loop.duration_s=0.5"});
  const RunResult limited = run(with_limited_elbow(free, slow));
  EXPECT_EQ(limited.complaints(), "");
  const session::PlantStatistics& plant = limited.of.at(Role::plant).statistics.plant();
  EXPECT_EQ(plant.beyond_limit_ticks.at(0), 0);
  EXPECT_GT(plant.beyond_limit_ticks.at(1), 10);
  // But for RUN_INFO, which holds the URDF, the logs are the same, byte for byte.
  const std::string unlimited = run(free).log;
  const auto ticks = [](const std::string& log) { return log.substr(log.find("ARM_TICK")); };
  EXPECT_TRUE(ticks(limited.log) == ticks(unlimited));
}

TEST(TheLoop, GivesTheSameLogEachTime) {
  const RunResult again = run(short_run());
  ASSERT_EQ(again.complaints(), "");
  EXPECT_TRUE(again.log == clean_log());
}

TEST(TheController, CommandsTheSameWhenThereIsNoTruth) {
  const scenario::Scenario scenario = short_run();
  // A plant that keeps its truth for itself.
  class Discreet : public Wrapped {
   public:
    using Wrapped::Wrapped;
    void publish(std::string_view channel, std::span<const std::byte> payload) override {
      if (channel != "ARM_TRUTH") Wrapped::publish(channel, payload);
    }
  };
  FourThreads threads(scenario);
  threads.wrap([](Role role, std::unique_ptr<bus::Transport> inner) {
    if (role == Role::plant) return std::unique_ptr<bus::Transport>(new Discreet(std::move(inner)));
    return inner;
  });
  // In the logger's place, one who acknowledges without truth and keeps the commands. The plant
  // takes an acknowledgement of a tick only after that tick is over.
  const auto endpoint = threads.network().connect("stand-in");
  std::map<std::int64_t, std::vector<std::byte>> commands;
  {
    Bystander stand_in([&](const std::atomic<bool>& stop) {
      session::Session session(scenario, *endpoint,
                               {.role = Role::logger,
                                .run_id = {},
                                .wait_s = 60,
                                .interrupted = nullptr,
                                .instance = 0});
      for (const auto* channel : {"ARM_RUN_INFO", "ARM_COMMAND", "ARM_TICK"}) {
        endpoint->subscribe(channel);
      }
      session.guard([&] {
        session.join({}, {});
        messages::Codec<messages::LogAck> acks(layout(scenario));
        messages::Codec<messages::TorqueCommand> codec(layout(scenario));
        std::int64_t newest = -1;
        session.membership().on_all_ticks_done();  // it does not mind what it misses
        while (!session.membership().has_plant_finished() && !stop) {
          session.poll(Clock::now());
          const auto datagram = endpoint->receive(Clock::now() + 1ms);
          if (datagram && session.handle(*datagram) != session::Session::Handled::no) continue;
          if (datagram && datagram->channel == "ARM_COMMAND") {
            messages::Stamp stamp;
            messages::TorqueCommand command;
            ASSERT_EQ(codec.decode(datagram->payload, stamp, command), messages::Rejection::none);
            commands[stamp.tick] = {datagram->payload.begin(), datagram->payload.end()};
            newest = stamp.tick;
          }
          const std::int64_t over =
              newest == scenario.loop.num_ticks - 1 && !datagram ? newest : newest - 1;
          endpoint->publish("ARM_LOG_ACK",
                            acks.encode({0, session.run(), std::max<std::int64_t>(over, -1)},
                                        messages::LogAck{}));
        }
        session.leave();
      });
    });
    threads.start(Role::plant);
    threads.start(Role::reference);
    threads.start(Role::controller);
    threads.wait();
  }
  ASSERT_EQ(commands.size(), static_cast<std::size_t>(scenario.loop.num_ticks));

  std::int64_t k = 0;
  const std::filesystem::path path = std::filesystem::path(testing::TempDir()) / "clean_lcmlog";
  std::ofstream(path, std::ios::binary) << clean_log();
  logger::LogReader log(path);
  while (const auto event = log.next()) {
    if (event->channel != "ARM_COMMAND") continue;
    EXPECT_TRUE(std::ranges::equal(event->data, commands.at(k))) << k;
    ++k;
  }
  EXPECT_EQ(k, scenario.loop.num_ticks);
  std::filesystem::remove(path);
}

/// Repeats the announcement of a running process with another state. @return whether it was one
bool announce_for(bus::Transport& bus, const bus::Datagram& heard,
                  messages::ParticipantState state) {
  messages::Codec<messages::Participant> codec(messages::Layout{});
  messages::Stamp stamp;
  messages::Participant who;
  if (codec.decode(heard.payload, stamp, who) != messages::Rejection::none ||
      who.state != messages::ParticipantState::running) {
    return false;
  }
  who.state = state;
  ++who.counter;  // or it would be a copy
  bus.publish("ARM_PARTICIPANT", codec.encode(stamp, who));
  return true;
}

/// Acknowledges every tick that is over as soon as it hears of the next one.
void acknowledge_for_the_logger(bus::Transport& bus, const std::atomic<bool>& stop) {
  bus.subscribe("ARM_TICK");
  messages::Codec<messages::LogAck> codec(messages::Layout{});
  while (!stop) {
    const auto heard = bus.receive(Clock::now() + 1ms);
    if (!heard) continue;
    const messages::Stamp stamp = messages::stamp_of(heard->payload);
    bus.publish("ARM_LOG_ACK", codec.encode({0, stamp.run, stamp.tick - 1}, messages::LogAck{}));
  }
}

TEST(AForgedAcknowledgement, OfAStrangerIsNotBelieved) {
  FourThreads threads(short_run(), {.loss = 0.05, .seed = 2});
  const auto stranger = threads.network().connect("a stranger");
  std::optional<Bystander> forger;
  forger.emplace(
      [&](const std::atomic<bool>& stop) { acknowledge_for_the_logger(*stranger, stop); });
  const RunResult result = threads.finish();
  forger.reset();
  ASSERT_EQ(result.complaints(), "");
  EXPECT_TRUE(result.log == clean_log());
  std::int64_t dropped = 0;
  for (const auto& entry : result.of.at(Role::plant).statistics.rejected.entries()) {
    if (entry.reason == "other_sender") dropped = entry.count;
  }
  EXPECT_GT(dropped, 0);
}

TEST(AForgedAcknowledgement, FromTheLoggersAddressDoesNotLetTheRunEndWell) {
  /// A logger that does not get the truth of the second half.
  class Deaf : public Wrapped {
   public:
    using Wrapped::Wrapped;
    std::optional<bus::Datagram> receive(Clock::time_point deadline) override {
      for (;;) {
        auto heard = Wrapped::receive(deadline);
        if (!heard || heard->channel != "ARM_TRUTH" ||
            messages::stamp_of(heard->payload).tick < 150) {
          return heard;
        }
      }
    }
  };
  FourThreads threads(short_run());
  threads.wrap([](Role role, std::unique_ptr<bus::Transport> inner) {
    if (role != Role::logger) return inner;
    return std::unique_ptr<bus::Transport>(new Deaf(std::move(inner)));
  });
  const auto stranger = threads.network().connect("logger's endpoint");
  std::optional<Bystander> forger;
  forger.emplace(
      [&](const std::atomic<bool>& stop) { acknowledge_for_the_logger(*stranger, stop); });
  const auto last_ack = threads.network().connect("logger's endpoint");
  std::optional<Bystander> last;
  last.emplace([&](const std::atomic<bool>& stop) {
    // The last tick is over when its truth is out.
    last_ack->subscribe("ARM_TRUTH");
    messages::Codec<messages::LogAck> codec(messages::Layout{});
    while (!stop) {
      const auto heard = last_ack->receive(Clock::now() + 1ms);
      if (!heard) continue;
      const messages::Stamp stamp = messages::stamp_of(heard->payload);
      if (stamp.tick < 299) continue;
      for (int i = 0; i < 100 && !stop; ++i) {
        last_ack->publish("ARM_LOG_ACK", codec.encode({0, stamp.run, 299}, messages::LogAck{}));
        std::this_thread::sleep_for(1ms);
      }
    }
  });
  const RunResult result = threads.finish();
  forger.reset();
  last.reset();
  EXPECT_EQ(result.of.at(Role::logger).statistics.logger().log.ticks, 150);
  // Reference and controller may have ended before: theirs is no promise of a log.
  for (const Role role : {Role::plant, Role::logger}) {
    EXPECT_EQ(result.of.at(role).code, ExitCode::protocol_violated) << messages::name(role);
    EXPECT_THAT(result.of.at(role).fault, HasSubstr("has not finished: ticks are missing there"));
  }
}

TEST(AKeyedBus, BelievesAcknowledgementsThoughAStrangerPassesOnTheLoggersAnnouncements) {
  /// The logger's announcements come from another address, the originals are lost.
  class PassedOn : public Wrapped {
   public:
    PassedOn(std::unique_ptr<bus::Transport> inner, std::unique_ptr<bus::Transport> stranger)
        : Wrapped(std::move(inner)), stranger_(std::move(stranger)) {}
    void publish(std::string_view channel, std::span<const std::byte> payload) override {
      if (channel != "ARM_PARTICIPANT") return Wrapped::publish(channel, payload);
      stranger_->publish(channel, payload);
    }

   private:
    std::unique_ptr<bus::Transport> stranger_;
  };
  FourThreads threads(short_run());
  threads.give_key({});
  threads.wrap([&](Role role, std::unique_ptr<bus::Transport> inner) {
    if (role != Role::logger) return inner;
    return std::unique_ptr<bus::Transport>(
        new PassedOn(std::move(inner), threads.network().connect("a stranger")));
  });
  const RunResult result = threads.finish();
  ASSERT_EQ(result.complaints(), "");
  EXPECT_TRUE(result.log == clean_log());
}

TEST(AForgedTruth, IsNoticedAtTheEndThoughThePlantsOwnIsLost) {
  /// A logger that hears another truth of the last tick, and never the plant's.
  class Deceived : public Wrapped {
   public:
    using Wrapped::Wrapped;
    std::optional<bus::Datagram> receive(Clock::time_point deadline) override {
      auto heard = Wrapped::receive(deadline);
      if (heard && heard->channel == "ARM_TRUTH" &&
          messages::stamp_of(heard->payload).tick == 299) {
        forged_.assign(heard->payload.begin(), heard->payload.end());
        forged_[44] ^= std::byte{1};  // in the mantissa of a position
        heard->payload = forged_;
      }
      return heard;
    }

   private:
    std::vector<std::byte> forged_;
  };
  FourThreads threads(short_run());
  threads.wrap([](Role role, std::unique_ptr<bus::Transport> inner) {
    if (role != Role::logger) return inner;
    return std::unique_ptr<bus::Transport>(new Deceived(std::move(inner)));
  });
  const RunResult result = threads.finish();
  for (const Role role : {Role::plant, Role::logger}) {
    EXPECT_EQ(result.of.at(role).code, ExitCode::protocol_violated) << messages::name(role);
    EXPECT_THAT(result.of.at(role).fault,
                HasSubstr("the messages recorded on ARM_TRUTH are not those"));
  }
  EXPECT_THAT(end_of(threads), HasSubstr("the logger: the messages recorded on ARM_TRUTH"));
}

TEST(AForgedEnd, IsBelievedBeforeTheLastTickByNobody) {
  FourThreads threads(short_run());
  const auto stranger = threads.network().connect("a stranger");
  stranger->subscribe("ARM_PARTICIPANT");
  std::atomic<int> forged = 0;
  std::optional<Bystander> forger;
  forger.emplace([&](const std::atomic<bool>& stop) {
    while (!stop) {
      const auto heard = stranger->receive(Clock::now() + 1ms);
      if (heard && announce_for(*stranger, *heard, messages::ParticipantState::finished)) ++forged;
    }
  });
  const RunResult result = threads.finish();
  forger.reset();
  EXPECT_GT(forged, 0);
  // The forger's counters outrun the real ones, so that members can fall silent for others. An end
  // announced between the last tick and the plant's own is plausible, but its digest is not that of
  // TRUTH. No run ends well with less than every tick.
  for (const Role role : {Role::plant, Role::logger}) {
    if (result.of.at(role).code == ExitCode::done) {
      EXPECT_TRUE(result.log.starts_with(clean_log())) << messages::name(role);
    }
  }
  for (const Role role : all_roles) {
    const Outcome& outcome = result.of.at(role);
    if (outcome.code == ExitCode::done || outcome.code == ExitCode::peer_lost) continue;
    EXPECT_EQ(outcome.code, ExitCode::protocol_violated) << messages::name(role);
    EXPECT_THAT(outcome.fault,
                AnyOf(HasSubstr("has not finished: ticks are missing there"),
                      HasSubstr("the messages recorded on ARM_TRUTH are not those")));
  }
}

TEST(TheLoop, EndsForAllWhenTwoProcessesCommand) {
  // Answers a measurement with a torque of its own.
  FourThreads threads(scenario("paper_rigid", {}));
  const auto second = threads.network().connect("second controller");
  second->subscribe("ARM_COMMAND");
  std::optional<Bystander> rival;
  rival.emplace([&](const std::atomic<bool>& stop) {
    messages::Codec<messages::TorqueCommand> codec(layout(short_run()));
    while (!stop) {
      const auto heard = second->receive(Clock::now() + 1ms);
      messages::Stamp stamp;
      messages::TorqueCommand command;
      if (!heard || codec.decode(heard->payload, stamp, command) != messages::Rejection::none)
        continue;
      command.tau[0] += 1;
      second->publish("ARM_COMMAND", codec.encode(stamp, command));
    }
  });
  const RunResult result = threads.finish();
  rival.reset();
  for (const Role role : all_roles) {
    EXPECT_EQ(result.of.at(role).code, ExitCode::protocol_violated) << messages::name(role);
  }
  const std::string all = result.complaints();
  EXPECT_THAT(all, HasSubstr("controller's endpoint"));
  EXPECT_THAT(all, HasSubstr("second controller"));
  EXPECT_THAT(end_of(threads), HasSubstr("two processes are the controller"));
}

TEST(TheLoop, EndsForAllWhenOneIsInterrupted) {
  for (const Role victim : all_roles) {
    SCOPED_TRACE(messages::name(victim));
    FourThreads threads(scenario("paper_rigid", {}));
    for (const Role role : all_roles) threads.start(role);
    const auto listener = threads.network().connect("listener");
    listener->subscribe("ARM_LOG_ACK");
    for (int acks = 0; acks < 4; ++acks) ASSERT_TRUE(listener->receive(Clock::now() + 60s));
    threads.interrupt(victim);
    const RunResult result = threads.finish();
    for (const Role role : all_roles) {
      const Outcome& outcome = result.of.at(role);
      EXPECT_EQ(outcome.code, role == victim ? ExitCode::interrupted : ExitCode::peer_lost);
      EXPECT_THAT(outcome.fault, HasSubstr("interrupted"));
      if (role == victim) continue;
      EXPECT_THAT(outcome.fault, HasSubstr(std::string(messages::name(victim))));
    }
    // Up to the interruption the log is readable and whole.
    EXPECT_FALSE(result.log.empty());
    // RUN_INFO, six messages a tick, and the fault.
    EXPECT_EQ(result.of.at(Role::logger).statistics.logger().log.events,
              1 + 6 * result.of.at(Role::logger).statistics.ticks + 1);
    EXPECT_THAT(end_of(threads),
                HasSubstr(fmt::format("the {}: interrupted", messages::name(victim))));
  }
}

TEST(TheLoop, EndsForAllWhenAPlantFailsThatWasBusyForLong) {
  /// Hears nothing for two seconds at tick 100, then slowly what has come meanwhile.
  class Busy : public Wrapped {
   public:
    Busy(std::unique_ptr<bus::Transport> inner, FourThreads& threads)
        : Wrapped(std::move(inner)), threads_(threads) {}
    void publish(std::string_view channel, std::span<const std::byte> payload) override {
      Wrapped::publish(channel, payload);
      if (busy_ || channel != "ARM_TICK" || messages::stamp_of(payload).tick != 100) return;
      busy_ = true;
      // More announcements of the others than may be answered late.
      std::this_thread::sleep_for(2s);
      threads_.interrupt(Role::plant);
    }
    std::optional<bus::Datagram> receive(Clock::time_point deadline) override {
      if (busy_) std::this_thread::sleep_for(2ms);
      return Wrapped::receive(deadline);
    }

   private:
    FourThreads& threads_;
    bool busy_ = false;
  };
  FourThreads threads(short_run());
  threads.wrap([&](Role role, std::unique_ptr<bus::Transport> inner) {
    if (role != Role::plant) return inner;
    return std::unique_ptr<bus::Transport>(new Busy(std::move(inner), threads));
  });
  const RunResult result = threads.finish();
  for (const Role role : all_roles) {
    EXPECT_THAT(result.of.at(role).fault, HasSubstr("interrupted")) << messages::name(role);
  }
}

TEST(TheLoop, EndsForAllWithExitCode5WhenItIsUnstable) {
  // The paper's gains at twenty times the period they are for.
  // Its last tick costs the integrator up to a second of processor time, several under a sanitizer:
  // the others wait for it.
  const RunResult result =
      run(scenario("paper_rigid", {"loop.period_s=1.0e-3", "plant.integrator.accuracy=1e-3",
                                   "loop.give_up_s=200", "plant.mechanics=native"}));
  for (const Role role : all_roles) {
    const Outcome& outcome = result.of.at(role);
    EXPECT_EQ(outcome.code, ExitCode::protective_stop) << messages::name(role);
    EXPECT_THAT(outcome.fault, HasSubstr("unstable")) << messages::name(role);
  }
  EXPECT_FALSE(result.log.empty());
}

TEST(TheLoop, IsRefusedBeforeItStartsWhenTheScenariosDiffer) {
  FourThreads threads(short_run());
  threads.give(Role::controller, scenario("paper_rigid", {"loop.duration_s=0.02"}));
  const RunResult result = threads.finish();
  EXPECT_EQ(result.of.at(Role::plant).code, ExitCode::bad_usage);
  EXPECT_EQ(result.of.at(Role::controller).code, ExitCode::bad_usage);
  EXPECT_THAT(result.of.at(Role::plant).fault, HasSubstr("the controller"));
  EXPECT_THAT(result.of.at(Role::plant).fault, HasSubstr("runs scenario 'paper_rigid'"));
}

}  // namespace
}  // namespace tachless::system_test
