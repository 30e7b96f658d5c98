#include "logger/node.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <optional>
#include <stdexcept>
#include <string>
#include <tuple>
#include <vector>

#include "app/logging.h"
#include "bus/lockstep/log_window.h"
#include "bus/truth/truth_wire.h"
#include "bus/wire.h"
#include "logger/log_file.h"

namespace logger {
namespace {

using bus::Clock;
using bus::lockstep::LogWindow;
using bus::lockstep::Slot;
using bus::lockstep::Verdict;

/// Checks messages of one type; what they say is of no interest here.
template <class Value>
class Checker {
 public:
  explicit Checker(const bus::Layout& layout) : codec_(layout) {}
  bus::Rejection check(std::span<const std::byte> payload, bus::Stamp& stamp) {
    return codec_.decode(payload, stamp, value_);
  }
  [[nodiscard]] std::size_t longest() const { return codec_.longest(); }

 private:
  bus::Codec<Value> codec_;
  Value value_;
};

bus::Layout layout(const app::Scenario& scenario, int num_filters) {
  return {.num_joints = scenario.num_joints,
          .num_motors = scenario.robot.flexible ? scenario.num_joints : 0,
          .num_filters = num_filters};
}

/// Whichever measurement the controller is fed with.
class MeasurementChecker {
 public:
  explicit MeasurementChecker(const bus::Layout& layout)
      : checkers_(Checker<robot::PositionMeasurement>(layout),
                  Checker<robot::MotorPositionMeasurement>(layout),
                  Checker<robot::LinkStateMeasurement>(layout),
                  Checker<robot::StateMeasurement>(layout)) {}

  /// @return whether there is such a measurement
  bool select(std::string_view suffix) {
    const std::array suffixes = {bus::ChannelOf<robot::PositionMeasurement>::suffix,
                                 bus::ChannelOf<robot::MotorPositionMeasurement>::suffix,
                                 bus::ChannelOf<robot::LinkStateMeasurement>::suffix,
                                 bus::ChannelOf<robot::StateMeasurement>::suffix};
    const auto found = std::ranges::find(suffixes, suffix);
    if (found == suffixes.end()) return false;
    selected_ = found - suffixes.begin();
    return true;
  }

  bus::Rejection check(std::span<const std::byte> payload, bus::Stamp& stamp) {
    switch (selected_) {
      case 0:
        return std::get<0>(checkers_).check(payload, stamp);
      case 1:
        return std::get<1>(checkers_).check(payload, stamp);
      case 2:
        return std::get<2>(checkers_).check(payload, stamp);
      case 3:
        return std::get<3>(checkers_).check(payload, stamp);
      default:
        throw std::logic_error("a measurement came before it was selected");
    }
  }

  [[nodiscard]] std::size_t longest() const {
    return std::apply([](const auto&... each) { return std::max({each.longest()...}); }, checkers_);
  }

 private:
  std::tuple<Checker<robot::PositionMeasurement>, Checker<robot::MotorPositionMeasurement>,
             Checker<robot::LinkStateMeasurement>, Checker<robot::StateMeasurement>>
      checkers_;
  std::ptrdiff_t selected_ = -1;
};

/// The logger does not know laws: a controller's state may have any number of filters.
class StateChecker {
 public:
  explicit StateChecker(const app::Scenario& scenario) {
    for (int filters = 0; filters <= robot::max_filters; ++filters) {
      checkers_.emplace_back(layout(scenario, filters));
    }
  }
  bus::Rejection check(std::span<const std::byte> payload, bus::Stamp& stamp) {
    for (auto& checker : checkers_) {
      const bus::Rejection rejection = checker.check(payload, stamp);
      if (rejection != bus::Rejection::wrong_size) return rejection;
    }
    return bus::Rejection::wrong_size;
  }
  [[nodiscard]] std::size_t longest() const { return checkers_.back().longest(); }

 private:
  std::vector<Checker<robot::ControllerState>> checkers_;
};

class Node {
 public:
  Node(const app::Scenario& scenario, bus::Transport& transport, app::Session& session,
       const std::filesystem::path& log_path)
      : transport_(transport),
        session_(session),
        robot_(scenario.robot.channel_prefix),
        run_info_channel_(bus::channel<bus::RunInfo>(robot_)),
        ack_channel_(bus::channel<bus::LogAck>(robot_)),
        run_info_codec_(layout(scenario, 0)),
        ack_codec_(layout(scenario, 0)),
        tick_(layout(scenario, 0)),
        measurement_(layout(scenario, 0)),
        reference_(layout(scenario, 0)),
        command_(layout(scenario, 0)),
        state_(scenario),
        truth_(layout(scenario, 0)),
        window_(scenario.loop.num_ticks,
                {tick_.longest(), measurement_.longest(), reference_.longest(), command_.longest(),
                 state_.longest(), truth_.longest()}),
        file_(log_path) {
    channel(Slot::tick) = bus::channel<bus::Tick>(robot_);
    channel(Slot::reference) = bus::channel<robot::ReferencePoint>(robot_);
    channel(Slot::command) = bus::channel<robot::TorqueCommand>(robot_);
    channel(Slot::controller_state) = bus::channel<robot::ControllerState>(robot_);
    channel(Slot::truth) = bus::channel<bus::truth::PlantTruth>(robot_);
    transport_.subscribe(run_info_channel_);
    for (const std::string& each : channels_) {
      if (!each.empty()) transport_.subscribe(each);
    }
    session_.statistics().log = app::Statistics::Log{log_path.string(), 0, 0, 0};
  }

  void run() {
    try {
      session_.meet();
      while (!session_.plant_finished()) {
        const auto now = Clock::now();
        session_.attend(now);
        file_.flush_if_due(now);
        if (const auto datagram = transport_.receive(session_.next_attention())) take(*datagram);
      }
    } catch (const app::Failure&) {
      save_the_rest();
      throw;
    }
    file_.close();
    session_.finish();
  }

 private:
  std::string& channel(Slot slot) { return channels_[static_cast<std::size_t>(slot)]; }

  void take(const bus::Datagram& datagram) {
    if (session_.take(datagram)) return;
    if (datagram.channel == run_info_channel_) {
      on_run_info(datagram);
    } else {
      const auto found = std::ranges::find(channels_, datagram.channel);
      if (found == channels_.end()) return;
      on_message(static_cast<Slot>(found - channels_.begin()), datagram);
    }
    write_complete_ticks();
    if (const auto ack = window_.take_ack()) {
      transport_.publish(ack_channel_, ack_codec_.encode({0, session_.run(), ack->tick},
                                                         bus::LogAck{ack->missing}));
    }
  }

  void on_run_info(const bus::Datagram& datagram) {
    bus::Stamp stamp;
    bus::RunInfo info;
    app::Statistics& statistics = session_.statistics();
    const bus::Rejection rejection = run_info_codec_.decode(datagram.payload, stamp, info);
    if (rejection != bus::Rejection::none) return statistics.rejected.add(rejection);
    if (stamp.run != session_.run()) return statistics.rejected.add(app::Unusable::other_run);
    if (stamp.tick != -1) return statistics.rejected.add(app::Unusable::not_asked);
    const bool first = run_info_.empty();
    if (first && !measurement_.select(info.measurement)) {
      return statistics.rejected.add(bus::Rejection::bad_value);
    }
    const bool same = std::ranges::equal(run_info_, datagram.payload);
    const Verdict verdict = window_.on_run_info(first || same);
    if (verdict == Verdict::conflicting) {
      throw app::Failure(app::ExitCode::protocol_violated,
                         "two plants drive run " + std::to_string(stamp.run) + ": " +
                             run_info_sender_ + " and " + std::string(datagram.sender) +
                             " describe it differently; end one of them");
    }
    if (!first) {
      ++statistics.duplicates;
      return;
    }
    run_info_.assign(datagram.payload.begin(), datagram.payload.end());
    run_info_sender_ = datagram.sender;
    channel(Slot::measurement) = robot_ + "_" + info.measurement;
    // Before the acknowledgement, and so before the first measurement.
    transport_.subscribe(channel(Slot::measurement));
    session_.started(Clock::now());
    append(stamp.utime, run_info_channel_, run_info_);
  }

  bus::Rejection check(Slot slot, std::span<const std::byte> payload, bus::Stamp& stamp) {
    switch (slot) {
      case Slot::tick:
        return tick_.check(payload, stamp);
      case Slot::measurement:
        return measurement_.check(payload, stamp);
      case Slot::reference:
        return reference_.check(payload, stamp);
      case Slot::command:
        return command_.check(payload, stamp);
      case Slot::controller_state:
        return state_.check(payload, stamp);
      case Slot::truth:
        return truth_.check(payload, stamp);
    }
    throw std::logic_error("no such slot");
  }

  void on_message(Slot slot, const bus::Datagram& datagram) {
    bus::Stamp stamp;
    app::Statistics& statistics = session_.statistics();
    const bus::Rejection rejection = check(slot, datagram.payload, stamp);
    if (rejection != bus::Rejection::none) return statistics.rejected.add(rejection);
    if (stamp.run != session_.run()) return statistics.rejected.add(app::Unusable::other_run);
    switch (window_.on_message(slot, stamp.tick, datagram.payload, datagram.sender)) {
      case Verdict::fresh:
        return;
      case Verdict::repeated:
        ++statistics.duplicates;
        return;
      case Verdict::not_asked:
        return statistics.rejected.add(app::Unusable::not_asked);
      case Verdict::too_old:
        return statistics.rejected.add(app::Unusable::too_old);
      case Verdict::conflicting:
        throw app::Failure(app::ExitCode::protocol_violated,
                           "two processes play one role in run " + std::to_string(stamp.run) +
                               ": " + std::string(window_.sender(stamp.tick, slot)) + " and " +
                               std::string(datagram.sender) + " sent different " + channel(slot) +
                               " messages for tick " + std::to_string(stamp.tick) +
                               "; end one of them");
    }
  }

  void write_complete_ticks() {
    while (const auto tick = window_.complete_tick()) {
      const auto begin = Clock::now();
      bus::Stamp stamp;
      if (tick_.check(window_.bytes(*tick, Slot::tick), stamp) != bus::Rejection::none) {
        throw std::logic_error("a kept message has changed");
      }
      for (int slot = 0; slot < bus::lockstep::num_slots; ++slot) {
        append(stamp.utime, channels_[static_cast<std::size_t>(slot)],
               window_.bytes(*tick, static_cast<Slot>(slot)));
      }
      window_.written();
      session_.progressed(*tick);
      session_.statistics().ticks = *tick + 1;
      session_.statistics().log->ticks = *tick + 1;
      session_.statistics().work.add(Clock::now() - begin);
    }
  }

  void append(std::int64_t utime, std::string_view channel, std::span<const std::byte> data) {
    file_.append(utime, channel, data);
    ++session_.statistics().log->events;
  }

  /// The run has failed: what has arrived already still belongs into the log.
  void save_the_rest() {
    constexpr int most = 10'000;  // whoever floods the bus must not keep us here
    try {
      for (int i = 0; i < most; ++i) {
        const auto datagram = transport_.receive(Clock::time_point::min());
        if (!datagram) break;
        take(*datagram);
      }
    } catch (const app::Failure&) {
      // The first failure is the one to tell.
    }
    try {
      file_.close();
    } catch (const app::Failure& failure) {
      app::log_warning(failure.what());
    }
  }

  bus::Transport& transport_;
  app::Session& session_;
  std::string robot_;
  std::string run_info_channel_;
  std::string ack_channel_;
  std::array<std::string, bus::lockstep::num_slots> channels_;  ///< by slot
  bus::Codec<bus::RunInfo> run_info_codec_;
  bus::Codec<bus::LogAck> ack_codec_;
  Checker<bus::Tick> tick_;
  MeasurementChecker measurement_;
  Checker<robot::ReferencePoint> reference_;
  Checker<robot::TorqueCommand> command_;
  StateChecker state_;
  Checker<bus::truth::PlantTruth> truth_;
  LogWindow window_;
  LogWriter file_;
  std::vector<std::byte> run_info_;
  std::string run_info_sender_;
};

}  // namespace

void run_node(const app::Scenario& scenario, bus::Transport& transport, app::Session& session,
              const std::filesystem::path& log_path) {
  Node(scenario, transport, session, log_path).run();
}

}  // namespace logger
