// Tests of whole runs of the protocol on a simulated network in virtual time. There are thousands
// of schedules, each from a seed, with loss, duplication, delay and reordering.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <map>
#include <queue>
#include <random>
#include <string>
#include <vector>

#include "session/log_window.h"
#include "session/responders.h"
#include "session/tick_master.h"
#include "tests/core/session/bytes_of.h"

namespace tachless::session {
namespace {

using namespace std::chrono_literals;
using Time = base::Clock::time_point;

std::uint64_t mix(std::uint64_t a, std::uint64_t b) {
  std::uint64_t x = a * 0x9E3779B97F4A7C15U + b + 0x7F4A7C15U;  // splitmix64's finaliser
  x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9U;
  x = (x ^ (x >> 27)) * 0x94D049BB133111EBU;
  return x ^ (x >> 31);
}

enum class Kind { tick, measurement, reference, command, state, truth, ack };
enum Node : int { plant, reference, controller, logger, num_nodes };

constexpr int messages_a_tick =
    static_cast<int>(index(Slot::truth)) + 1;  // neither contact nor torques told

struct Message {
  Kind kind = Kind::tick;
  std::int64_t tick = -1;
  std::uint64_t content = 0;
};

struct Network {
  double loss = 0;
  double duplication = 0;
  double straggling = 0;  ///< share of the messages that take up to `longest_delay`
  std::chrono::nanoseconds longest_delay = 5ms;
};

/// The four processes as their nodes drive them, with numbers instead of physics. Every value
/// depends on all earlier ones, so a tick computed twice or out of order changes the log.
class SimulatedRun {
 public:
  SimulatedRun(std::int64_t num_ticks, const Network& network, std::uint64_t seed)
      : network_(network),
        random_(seed),
        tick_master_(config(num_ticks)),
        reference_(num_ticks, 8),
        controller_(num_ticks, 8, 8),
        log_(num_ticks, {8, 8, 8, 8, 8, 8}) {}

  void run() {
    while (!tick_master_.is_finished() && now_ < Time(1h)) {
      drive_plant();
      const Time wake = tick_master_.deadline();
      if (events_.empty() && wake == Time::max()) break;
      if (events_.empty() || wake < events_.top().at) {
        now_ = std::max(now_, wake);
        continue;
      }
      const Event event = events_.top();
      events_.pop();
      now_ = event.at;
      receive(event.to, event.message);
    }
  }

  bool finished() const { return tick_master_.is_finished(); }
  const std::vector<std::uint64_t>& log() const { return written_; }
  std::int64_t published() const { return published_; }
  std::int64_t repeats() const { return repeats_; }
  std::int64_t acks() const { return acks_; }
  std::int64_t widest() const { return widest_; }
  int conflicts() const { return conflicts_; }
  Time end() const { return now_; }
  /// Returns the events of a run of less than 64 ticks, for tests/model/ticks.pml.
  const std::string& trace() const { return trace_; }
  /// Returns the number of computations by process and tick.
  const std::map<std::pair<int, std::int64_t>, int>& computations() const { return computations_; }

 private:
  struct Event {
    Time at;
    std::uint64_t order;
    Node to;
    Message message;
    bool operator>(const Event& other) const {
      return at != other.at ? at > other.at : order > other.order;
    }
  };

  static TickMaster::Config config(std::int64_t num_ticks) {
    TickMaster::Config result;
    result.num_ticks = num_ticks;
    result.give_up = 1h;
    return result;
  }

  bool chance(double probability) { return unit_(random_) < probability; }

  void publish(Node from, const Message& message) {
    ++published_;
    for (int to = 0; to < num_nodes; ++to) {
      if (to == from) continue;
      if (chance(network_.loss)) continue;
      deliver(static_cast<Node>(to), message);
      if (chance(network_.duplication)) deliver(static_cast<Node>(to), message);
    }
  }

  void deliver(Node to, const Message& message) {
    const auto longest =
        chance(network_.straggling) ? network_.longest_delay : std::chrono::nanoseconds(30us);
    const auto delay = 10us + std::chrono::nanoseconds(
                                  static_cast<std::int64_t>(unit_(random_) * longest.count()));
    events_.push({now_ + delay, ++order_, to, message});
  }

  void drive_plant() {
    for (;;) {
      while (const auto repeat = tick_master_.next_repeat(now_)) {
        ++repeats_;
        const std::int64_t k = repeat->tick;
        publish(plant, {Kind::tick, k, mix(1, k)});
        publish(plant, {Kind::measurement, k, measurements_.at(k)});
        if (repeat->what == TickMaster::Repeat::What::all) {
          publish(plant, {Kind::truth, k, truths_.at(k)});
        }
      }
      if (!tick_master_.may_begin()) return;
      const std::int64_t k = tick_master_.next_tick();
      ++computations_[{plant, k}];
      widest_ = std::max(widest_, k - (std::ssize(written_) / messages_a_tick - 1));
      measurements_[k] = mix(plant_state_, k);
      publish(plant, {Kind::tick, k, mix(1, k)});
      publish(plant, {Kind::measurement, k, measurements_[k]});
      tick_master_.on_asked(now_);
      trace(0, k, k);
    }
  }

  void receive(Node to, const Message& message) {
    // Messages that each process takes, by their bit in tests/model/ticks.pml.
    static const std::map<std::pair<Node, Kind>, int> taken = {
        {{reference, Kind::tick}, 1},       {{controller, Kind::measurement}, 2},
        {{controller, Kind::reference}, 4}, {{plant, Kind::command}, 8},
        {{logger, Kind::tick}, 16},         {{logger, Kind::measurement}, 32},
        {{logger, Kind::reference}, 64},    {{logger, Kind::command}, 128},
        {{logger, Kind::state}, 256},       {{logger, Kind::truth}, 512},
        {{plant, Kind::ack}, 1024}};
    const auto found = taken.find({to, message.kind});
    if (found == taken.end()) return;
    std::int64_t tick = message.tick, count = 0;
    switch (to) {
      case plant:
        plant_receives(message);
        if (message.kind == Kind::ack) ++tick;
        count =
            message.kind == Kind::ack ? tick_master_.acknowledged() + 1 : tick_master_.next_tick();
        break;
      case reference:
        reference_receives(message);
        count = reference_.newest() + 1;
        break;
      case controller:
        controller_receives(message);
        count = controller_.next();
        break;
      default:
        logger_receives(message);
        count = std::ssize(written_) / messages_a_tick;
    }
    trace(found->second, tick, count);
  }

  void trace(int kind, std::int64_t tick, std::int64_t count) {
    trace_ += std::to_string((kind * 64 + tick) * 64 + count) + " ";
  }

  void note(Receipt receipt) { conflicts_ += receipt == Receipt::conflicting ? 1 : 0; }

  void plant_receives(const Message& message) {
    if (message.kind == Kind::ack) {
      note(tick_master_.on_ack(message.tick, message.content, now_));
    } else if (message.kind == Kind::command) {
      const Receipt receipt = tick_master_.on_command(message.tick, BytesOf(message.content), now_);
      note(receipt);
      if (receipt != Receipt::fresh) return;
      truths_[message.tick] = mix(plant_state_, message.content);
      publish(plant, {Kind::truth, message.tick, truths_[message.tick]});
      plant_state_ = truths_[message.tick];
      tick_master_.on_completed(now_);
    }
  }

  void reference_receives(const Message& message) {
    if (message.kind != Kind::tick) return;
    const auto answer = reference_.on_tick(message.tick, BytesOf(message.content));
    note(answer.receipt);
    for (std::int64_t k = answer.repeat.first; k <= answer.repeat.last; ++k) {
      publish(reference, {Kind::reference, k, number_in(reference_.kept(k))});
    }
    for (std::int64_t k = answer.compute.first; k <= answer.compute.last; ++k) {
      ++computations_[{reference, k}];
      reference_state_ = mix(reference_state_, k);
      reference_.on_computed(k, BytesOf(reference_state_));
      publish(reference, {Kind::reference, k, reference_state_});
    }
  }

  void controller_receives(const Message& message) {
    CommandResponder::Answer answer;
    if (message.kind == Kind::measurement) {
      answer = controller_.on_input(measurement_input, message.tick, BytesOf(message.content));
    } else if (message.kind == Kind::reference) {
      answer = controller_.on_input(reference_input, message.tick, BytesOf(message.content));
    } else {
      return;
    }
    note(answer.receipt);
    if (answer.receipt == Receipt::fresh) inputs_[{message.kind, message.tick}] = message.content;
    if (answer.action == CommandResponder::Action::nothing) return;
    if (answer.action == CommandResponder::Action::repeat) return publish_answers(message.tick);
    const std::int64_t k = controller_.next();
    ++computations_[{controller, k}];
    memory_ =
        mix(memory_, mix(inputs_.at({Kind::measurement, k}), inputs_.at({Kind::reference, k})));
    controller_.on_computed(BytesOf(memory_), BytesOf(mix(memory_, 1)));
    publish_answers(k);
  }

  void publish_answers(std::int64_t k) {
    publish(controller, {Kind::command, k, number_in(controller_.command(k))});
    publish(controller, {Kind::state, k, number_in(controller_.state(k))});
  }

  void logger_receives(const Message& message) {
    static const std::map<Kind, Slot> slots = {{Kind::tick, Slot::tick},
                                               {Kind::measurement, Slot::measurement},
                                               {Kind::reference, Slot::reference},
                                               {Kind::command, Slot::command},
                                               {Kind::state, Slot::controller_state},
                                               {Kind::truth, Slot::truth}};
    if (slots.contains(message.kind)) {
      note(log_.on_message(slots.at(message.kind), message.tick, BytesOf(message.content)));
    }
    while (const auto k = log_.complete_tick()) {
      ++computations_[{logger, *k}];
      for (int slot = 0; slot < messages_a_tick; ++slot) {
        written_.push_back(number_in(log_.bytes(*k, static_cast<Slot>(slot))));
      }
      log_.on_written();
    }
    if (const auto ack = log_.take_ack()) {
      ++acks_;
      publish(logger, {Kind::ack, ack->tick, ack->missing});
    }
  }

  Network network_;
  std::mt19937_64 random_;
  std::uniform_real_distribution<double> unit_;
  std::priority_queue<Event, std::vector<Event>, std::greater<>> events_;
  std::uint64_t order_ = 0;
  Time now_{};

  TickMaster tick_master_;
  ReferenceResponder reference_;
  CommandResponder controller_;
  LogWindow log_;

  std::uint64_t plant_state_ = 7, reference_state_ = 3, memory_ = 5;
  std::map<std::int64_t, std::uint64_t> measurements_, truths_;
  std::vector<std::uint64_t> written_;
  std::map<std::pair<int, std::int64_t>, int> computations_;
  std::map<std::pair<Kind, std::int64_t>, std::uint64_t> inputs_;  ///< inputs of the controller
  std::int64_t published_ = 0, repeats_ = 0, acks_ = 0, widest_ = 0;
  int conflicts_ = 0;
  std::string trace_;
};

void expect_sound(const SimulatedRun& run, std::int64_t num_ticks,
                  const std::vector<std::uint64_t>& log) {
  ASSERT_TRUE(run.finished());
  EXPECT_EQ(run.conflicts(), 0);
  EXPECT_LE(run.widest(), 48);
  ASSERT_EQ(run.computations().size(), static_cast<std::size_t>(num_nodes * num_ticks));
  for (const auto& [what, count] : run.computations()) {
    ASSERT_EQ(count, 1) << "process " << what.first << ", tick " << what.second;
  }
  ASSERT_TRUE(run.log() == log) << "the log depends on the schedule";
}

std::vector<std::uint64_t> clean_log(std::int64_t num_ticks) {
  SimulatedRun run(num_ticks, {}, 0);
  run.run();
  return run.log();
}

TEST(ALockstepRun, OverACleanNetworkRepeatsNothing) {
  constexpr std::int64_t num_ticks = 1000;
  SimulatedRun run(num_ticks, {}, 1);
  run.run();
  expect_sound(run, num_ticks, clean_log(num_ticks));
  EXPECT_EQ(run.log().size(), 6U * num_ticks);
  EXPECT_EQ(run.repeats(), 0);
  // Six messages a tick and one acknowledgement in 16 ticks, and some at the start and the end. The
  // interval is 15 ticks if a tick is complete only after the next has begun.
  EXPECT_EQ(run.published() - run.acks(), 6 * num_ticks);
  EXPECT_LE(run.acks(), num_ticks / 15 + 2);
}

TEST(ALockstepRun, GivesTheSameLogUnderEverySchedule) {
  constexpr std::int64_t num_ticks = 120;  // several windows and turns of the ring
  const auto log = clean_log(num_ticks);
  for (std::uint64_t seed = 0; seed < 3000; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> unit;
    Network network;
    network.loss = 0.3 * unit(random);
    network.duplication = 0.1 * unit(random);
    network.straggling = 0.3 * unit(random);
    network.longest_delay = std::chrono::nanoseconds(static_cast<std::int64_t>(2e7 * unit(random)));
    SimulatedRun run(num_ticks, network, seed);
    run.run();
    expect_sound(run, num_ticks, log);
    if (HasFailure()) break;
  }
}

TEST(ALockstepRun, RecoversFromHeavyLossWithoutAStorm) {
  constexpr std::int64_t num_ticks = 1000;
  const auto log = clean_log(num_ticks);
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    SimulatedRun run(num_ticks, {.loss = 0.3, .duplication = 0.1, .straggling = 0.05}, seed);
    run.run();
    expect_sound(run, num_ticks, log);
    // Measured 23 messages and 1.5 to 1.8 ms a tick; 6 messages and 0.1 ms in a clean run.
    EXPECT_LE(run.published(), 30 * num_ticks);
    EXPECT_LE(run.end() - Time{}, num_ticks * 4ms);
  }
}

// tests/model/model_test.py replays the traces.
TEST(ALockstepRun, GivesTracesForTheModel) {
  for (const std::uint64_t seed : {1, 2, 3}) {
    SimulatedRun run(20, {.loss = 0.3, .duplication = 0.1, .straggling = 0.3}, seed);
    run.run();
    ASSERT_TRUE(run.finished());
    RecordProperty("trace_" + std::to_string(seed), run.trace());
  }
}

TEST(ALockstepRun, SurvivesShortAndLongRuns) {
  for (const std::int64_t num_ticks : {1, 2, 3, 15, 16, 17, 47, 48, 49, 63, 64, 65, 2000}) {
    SCOPED_TRACE(num_ticks);
    const auto log = clean_log(num_ticks);
    for (std::uint64_t seed = 0; seed < 20; ++seed) {
      SimulatedRun run(num_ticks, {.loss = 0.3, .duplication = 0.1, .straggling = 0.1}, seed);
      run.run();
      expect_sound(run, num_ticks, log);
    }
  }
}

}  // namespace
}  // namespace tachless::session
