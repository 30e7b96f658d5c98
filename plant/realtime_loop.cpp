#include <fmt/core.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <optional>
#include <string>
#include <utility>

#include "base/clock.h"
#include "base/failure.h"
#include "base/logging.h"
#include "base/text.h"
#include "messages/wire.h"
#include "plant/clock_rate.h"
#include "plant/node.h"
#include "plant/plant_loop.h"
#include "session/responders.h"

namespace tachless::plant {
namespace {

using namespace std::chrono_literals;
using base::Clock;
using base::ExitCode;
using base::Failure;
using base::nanoseconds_of;
using messages::Role;
using messages::truth::DriveFault;
using session::Receipt;

// Time from the last confirmation of the roster to the first tick.
constexpr auto lead_in = 5ms;
// A flood of datagrams must not delay the next tick.
constexpr int most_at_once = 64;

double milliseconds(std::chrono::nanoseconds duration) {
  return std::chrono::duration<double, std::milli>(duration).count();
}

class RealtimeLoop : PlantLoop {
 public:
  RealtimeLoop(const scenario::Scenario& scenario, session::Session& session, RobotDriver* driver,
               Simulator* simulator)
      : PlantLoop(scenario, session, driver, simulator),
        driver_(driver),
        commands_(scenario.loop.max_missed),
        clock_rate_(scenario.loop.period_s, base::seconds_of(longest_hold())) {
    session_.on(
        command_port_, [this](const auto&... message) { on_command(message...); },
        [this](auto rejection, const auto& datagram) {
          if (tick_ < 0) refuse_early(datagram);
          require_finite(rejection, datagram);
        });
  }

  void run() {
    session_.join({}, [this](const bus::Datagram& datagram) {
      if (datagram.channel == command_port_.channel) refuse_early(datagram);
    });
    prepare();
    session_.note_started(Clock::now());
    try {
      require_seconds();
      robot_.start();
      start();
      for (tick_ = 0; tick_ < scenario_.loop.num_ticks; ++tick_) {
        if (!begin_tick()) break;
        receive_until(end_of_tick());
        end_tick();
      }
    } catch (...) {
      robot_.stop();  // the robot stops before anything else
      const Failure failure = base::current_failure();
      come_to_rest(failure);
      end_driver();
      robot_.require_stopped(&failure);
      throw;
    }
    robot_.stop();
    end_driver();
    robot_.require_stopped();
    session_.leave();
    judge_deadlines();
  }

 private:
  [[nodiscard]] Time deadline(std::int64_t tick) const {
    return start_ + nanoseconds_of(static_cast<double>(tick) * scenario_.loop.period_s);
  }
  [[nodiscard]] Time end_of_tick() const {
    // A robot that is the clock has waited in `act` already, or waits for its torque.
    if (robot_.is_clock()) {
      return acted_ ? Time() : asked_ + nanoseconds_of(scenario_.loop.period_s / 2);
    }
    // Late ticks in immediate succession would all miss their commands.
    return std::max(deadline(tick_ + 1), tick_began_ + nanoseconds_of(scenario_.loop.period_s / 2));
  }

  /// Notes the driver's figures, and lets its robot rest until the process ends.
  void end_driver() {
    if (driver_ == nullptr) return;
    try {
      for (const DriverFigure& figure : robot_.figures()) {
        session_.statistics().plant().driver[figure.name] = figure.value;
      }
    } catch (const Failure& problem) {
      base::log_warning("the driver's figures are missing: {}", problem.what());
    }
    if (!robot_.has_started()) return;
    const double end_s = static_cast<double>(tick_ + 1) * scenario_.loop.period_s;
    session_.while_attending(nanoseconds_of(scenario_.loop.period_s),
                             [driver = driver_, end_s, failed = false]() mutable {
                               if (failed) return;
                               try {
                                 driver->rest(end_s);
                               } catch (...) {
                                 failed = true;
                                 base::log_warning("the driver's rest failed after the run: {}",
                                                   base::current_failure().what());
                               }
                             });
  }

  /// Judges the share of missed deadlines. The run and its log are complete in either case.
  void judge_deadlines() {
    const auto missed = session_.statistics().plant().missed_deadlines;
    const double share =
        static_cast<double>(missed) / static_cast<double>(scenario_.loop.num_ticks);
    if (share <= scenario_.loop.max_missed_share) return;
    session_.statistics().exit_code = ExitCode::check_said_no;
    session_.statistics().fault = fmt::format(
        "{} of {} deadlines were missed ({:.3g} %), more than loop.max_missed_share ({}) allows: "
        "this machine is too slow, too busy or without real-time rights for ticks of {:.6g} ms; "
        "type: tachless doctor; or lengthen loop.period_s",
        missed, scenario_.loop.num_ticks, 100 * share,
        base::shortest(scenario_.loop.max_missed_share), 1e3 * scenario_.loop.period_s);
  }

  /// Throws when the bytes on the command channel have the shape of a command, of any run.
  void refuse_early(const bus::Datagram& datagram) {
    messages::Stamp stamp;
    messages::TorqueCommand command;
    const auto rejection = command_port_.codec.decode(datagram.payload, stamp, command);
    if (rejection != messages::Rejection::none && rejection != messages::Rejection::non_finite)
      return;
    throw Failure(ExitCode::protocol_violated,
                  "a command came on {} before the start, from {} (run {}): an old controller is "
                  "still there; end it first",
                  datagram.channel, datagram.sender, messages::stamp_of(datagram.payload).run);
  }

  /// Returns the longest time for which a torque may be held. A robot that is the clock gets the
  /// torque of a tick before lost states after them, and its first new one a tick later.
  [[nodiscard]] std::chrono::nanoseconds longest_hold() const {
    const int more = robot_.is_clock() ? 3 : 2;
    return nanoseconds_of(scenario_.loop.period_s * (scenario_.loop.max_missed + more));
  }

  /// Reads a robot that tells its time until its clock runs as fast as this computer's for one
  /// window. The first readings may be older than the others.
  /// @throw Failure(bad_usage) when it never does
  void require_seconds() {
    if (robot_.emulated()) return;
    constexpr int most_windows = 20;
    for (int windows = 0; windows < most_windows;) {
      const Time asked = Clock::now();
      const double own_s = robot_.read(-1).time_s;
      if (!std::isfinite(own_s)) return;
      const auto window = clock_rate_.add(own_s, asked, Clock::now());
      if (window && window->sound) return;
      if (window && ++windows == most_windows) {
        throw base::bad_usage(
            "the driver's time runs {:.3g} times as fast as this computer's clock; give "
            "ArmState::time_s in seconds, or leave it out",
            window->rate);
      }
      const Time next = asked + nanoseconds_of(scenario_.loop.period_s);
      while (!robot_.is_clock() && Clock::now() < next) session_.receive(next);
    }
  }

  /// @throw Failure(protective_stop) when the driver's time runs at another speed than the clock
  /// @param skipped ticks that passed by the driver's time since the last reading
  void watch_time(std::int64_t skipped) {
    if (robot_.emulated() || !robot_.has_reading()) return;
    const Time now = Clock::now();
    const auto window = clock_rate_.add(robot_.state().time_s, tick_began_, now);
    std::optional<double> rate;
    if (window && !window->sound) rate = window->rate;
    // A time that jumps ahead must not end the run before a window has ended.
    const double own_s = static_cast<double>(tick_) * scenario_.loop.period_s;
    const double passed_s = base::seconds_of(now - start_);
    const double late_s = ClockRate::window_s + base::seconds_of(longest_hold());
    if (skipped > 0 && own_s > ClockRate::factor * passed_s + late_s) rate = own_s / passed_s;
    if (!rate) return;
    throw protective_stop(fmt::format(
        "the driver's time ran {:.3g} times as fast as this computer's clock: speeds cannot be "
        "watched; give ArmState::time_s in seconds, or leave it out",
        *rate));
  }

  void start() {
    start_ = Clock::now() + (robot_.is_clock() ? 0ms : lead_in);
    commanded_at_ = start_;
    while (Clock::now() < start_) session_.receive(start_);
  }

  /// @return false if the run's last tick has passed, by the robot's own time
  bool begin_tick() {
    tick_began_ = Clock::now();
    const std::int64_t skipped = read();
    watch_time(skipped);
    note_wake_up(tick_began_, skipped);
    require_commands();
    if (tick_ >= scenario_.loop.num_ticks) return false;
    ask(tick_began_);
    if (scenario_.loop.command_delay > 0) {
      act(held_ ? DriveFault::command_missed : DriveFault::none);
    }
    return true;
  }

  /// Reads the robot, and lets the ticks pass that it had by its own time without an answer.
  /// @return their number
  std::int64_t read() {
    robot_.read(tick_);
    const std::int64_t skipped = std::min(robot_.tick(), scenario_.loop.num_ticks) - tick_;
    if (skipped > 0) {
      commands_.skip(skipped);
      robot_.skip(skipped);
      held_ = true;
      tick_ += skipped;
      note_commands();
    }
    const std::int64_t unread = skipped + (robot_.has_reading() ? 0 : 1);
    if (std::exchange(was_read_, robot_.has_reading()) || unread == 0) unread_in_a_row_ = 0;
    unread_in_a_row_ += unread;
    session::PlantStatistics& statistics = session_.statistics().plant();
    statistics.missed_readings += unread;
    statistics.longest_reading_miss = std::max(statistics.longest_reading_miss, unread_in_a_row_);
    return skipped;
  }

  void note_wake_up(Time now, std::int64_t skipped) {
    const double period_s = scenario_.loop.period_s;
    std::chrono::nanoseconds late = now - deadline(tick_);
    std::int64_t missed = late > nanoseconds_of(period_s) ? 1 : 0;
    if (robot_.is_clock()) {
      const auto passed = now - std::exchange(last_began_, now);
      const auto planned = nanoseconds_of(static_cast<double>(skipped + 1) * period_s);
      late = tick_ == 0 ? 0ns : std::chrono::abs(passed - planned);
      // Without the robot's time nobody knows how many ticks were lost.
      const bool timed = std::isfinite(robot_.state().time_s);
      const bool long_tick = tick_ > 0 && passed > nanoseconds_of(1.5 * period_s);
      missed = timed ? skipped : std::int64_t{long_tick};
      late_in_a_row_ = timed ? 0 : late_in_a_row_;
    }
    session::PlantStatistics& statistics = session_.statistics().plant();
    statistics.wake_up_jitter_us.add(late);
    if (commands_.missed_in_a_row() == 0) longest_delay_ = 0ns;
    longest_delay_ = std::max<std::chrono::nanoseconds>(longest_delay_, late);
    statistics.missed_deadlines += missed;
    late_in_a_row_ = missed > 0 ? late_in_a_row_ + missed : 0;
    statistics.longest_miss = std::max(statistics.longest_miss, late_in_a_row_);
  }

  void ask(Time now) {
    begun_ = true;
    commands_.begin(tick_);
    messages::Stamp tick_stamp = stamp(tick_);
    tick_stamp.utime = (now - start_) / 1us;
    asked_ = publish_request(tick_stamp).sent;
  }

  void act(DriveFault fault) {
    publish_truth(tick_, fault);
    acted_ = true;
    const auto now = Clock::now();
    if (fault != DriveFault::protective_stop && !robot_.emulated()) require_recent_torque(now);
    if (fault == DriveFault::none) commanded_at_ = now;
    const auto took = robot_.advance(tick_);
    if (!robot_.is_clock()) session_.statistics().work_us.add(took);
  }

  void require_recent_torque(Time now) const {
    // A real robot does not wait for a process that stands still. Missed commands alone end the run
    // before this.
    const auto held_for = now - commanded_at_;
    if (held_for <= longest_hold()) return;
    throw protective_stop(fmt::format(
        "the robot's torque has been held for {:.1f} ms, longer than loop.max_missed ({}) allows: "
        "{}this process, or the driver's read, made no progress; start a new run on a machine that "
        "is quiet (tachless doctor), with a read that does not wait",
        milliseconds(held_for), scenario_.loop.max_missed,
        commands_.missed_in_a_row() > 0 ? what_is_missing() + ", and " : ""));
  }

  void receive_until(Time deadline) {
    session_.poll(Clock::now());
    while (Clock::now() < deadline) {
      session_.receive(std::min(deadline, session_.next_poll()));
      const auto now = Clock::now();
      if (now < deadline) session_.poll(now);
    }
    // A datagram that arrived in time counts, although it is read only now.
    for (int i = 0; i < most_at_once && session_.receive(Time()); ++i) {
    }
  }

  void on_command(const messages::Stamp& stamp, const messages::TorqueCommand& command,
                  const bus::Datagram& datagram) {
    session::PlantStatistics& statistics = session_.statistics().plant();
    const Receipt receipt = commands_.on_command(stamp.tick, datagram.payload);
    if (receipt == Receipt::too_old) {
      ++statistics.late_commands;
      return;
    }
    session_.count(receipt, Role::controller, datagram, stamp.tick);
    if (receipt != Receipt::fresh) return;
    statistics.command_age_us.add(Clock::now() - asked_);
    robot_.accept(command);
    if (scenario_.loop.command_delay == 0) act(DriveFault::none);
  }

  void end_tick() {
    commands_.end();
    held_ = !commands_.is_commanded();
    if (!acted_) act(DriveFault::command_missed);
    robot_.end_tick();
    begun_ = false;
    acted_ = false;

    note_commands();
    note_completed(tick_);
    require_commands();
  }

  void note_commands() {
    session::PlantStatistics& statistics = session_.statistics().plant();
    statistics.missed_commands = commands_.missed();
    statistics.longest_command_miss = commands_.longest_miss();
  }

  /// @throw Failure(protective_stop) when more than loop.max_missed commands in a row are missing
  void require_commands() const {
    if (!commands_.has_missed_too_many()) return;
    // The others are not to blame if the plant itself was late.
    const std::string remedy =
        longest_delay_ <= nanoseconds_of(scenario_.loop.period_s)
            ? "; mend that and start a new run"
            : fmt::format(
                  ". The plant itself woke up to {:.1f} ms late: this machine stood still "
                  "or is too busy (tachless doctor); start a new run on a quieter one",
                  milliseconds(longest_delay_));
    throw protective_stop(fmt::format("{}, more than loop.max_missed ({}){}", what_is_missing(),
                                      scenario_.loop.max_missed, remedy));
  }

  [[nodiscard]] Failure protective_stop(const std::string& why) const {
    return {ExitCode::protective_stop, fmt::format("protective stop at tick {}: {}", tick_, why)};
  }

  [[nodiscard]] std::string what_is_missing() const {
    if (unread_in_a_row_ > 0) {
      return fmt::format(
          "{} commands in a row are missing, since the driver had no reading of the robot in the "
          "last {} ticks",
          commands_.missed_in_a_row(), unread_in_a_row_);
    }
    return fmt::format("{} commands in a row did not come in time from {}",
                       commands_.missed_in_a_row(),
                       session_.silent_among({Role::controller, Role::reference}));
  }

  /// Announces the failure, and measures the robot, which is stopped already, until it stands
  /// still.
  void come_to_rest(const Failure& failure) {
    try {
      session_.announce_stop(failure, Clock::now());
      if (tick_ < 0) return;  // the run has not begun
      if (begun_ && !acted_) act(DriveFault::protective_stop);
      const auto most = static_cast<std::int64_t>(
          std::chrono::duration<double>(longest_stop).count() / scenario_.loop.period_s);
      const std::int64_t end = std::min(scenario_.loop.num_ticks, tick_ + 1 + most);
      for (++tick_; tick_ < end; ++tick_) {
        while (!robot_.is_clock() && Clock::now() < deadline(tick_)) {
          session_.attend(std::min(deadline(tick_), session_.next_poll()));
          session_.announce_if_due(Clock::now());
        }
        session_.announce_if_due(Clock::now());  // a late loop announces too
        read();
        if (tick_ >= end) break;
        ask(Clock::now());
        act(DriveFault::protective_stop);
        note_completed(tick_);
        if (robot_.at_rest()) break;
      }
    } catch (...) {
      // The bus or the robot has failed too. The caller reports `failure`.
    }
  }

  RobotDriver* driver_;  ///< null with the emulator
  session::MissedCommandMonitor commands_;
  ClockRate clock_rate_;  ///< of a robot that tells its time
  Time start_;
  Time tick_began_;    ///< tick_ did, on time or late
  Time last_began_;    ///< of a robot that is the clock: when the tick before did
  Time asked_;         ///< when the measurement of tick_ was published
  Time commanded_at_;  ///< when the drives last got a torque that had come
  std::int64_t tick_ = -1;
  bool begun_ = false;  ///< the request of tick_ has been published
  bool acted_ = false;  ///< the torque over tick_ is decided, and its TRUTH published
  bool held_ = false;   ///< the command of the last tick is missing
  std::int64_t late_in_a_row_ = 0;
  std::int64_t unread_in_a_row_ = 0;          ///< ticks without a reading
  bool was_read_ = true;                      ///< the last tick had a reading
  std::chrono::nanoseconds longest_delay_{};  ///< of own wake-ups since the last command
};

}  // namespace

void run_realtime(const scenario::Scenario& scenario, session::Session& session,
                  RobotDriver* driver, Simulator* simulator) {
  RealtimeLoop(scenario, session, driver, simulator).run();
}

}  // namespace tachless::plant
