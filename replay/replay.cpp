#include "replay/replay.h"

#include <fmt/core.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <memory>
#include <stdexcept>
#include <type_traits>
#include <utility>
#include <variant>

#include "diagnostics/failure.h"

namespace tachless::replay {
namespace {

template <class... Args>
[[noreturn]] void refuse(const logger::RunLog& log, fmt::format_string<Args...> problem,
                         Args&&... args) {
  throw diagnostics::bad_usage("{}: {}", log.path().string(),
                               fmt::format(problem, std::forward<Args>(args)...));
}

/// What the law measures, from what was measured: a state holds the lesser measurements too.
template <class Wanted>
std::optional<Wanted> measured(const loop::OptionalMeasurement& measurement) {
  return std::visit(
      []<class Had>(const Had& had) -> std::optional<Wanted> {
        if constexpr (!std::is_same_v<Had, std::monostate>) {
          if constexpr (loop::is_part_of<Wanted, Had>()) return loop::part_of<Wanted>(had);
        }
        return {};
      },
      measurement);
}

/// Whether `measured` finds the second in the first; both are suffixes of channels.
bool holds(std::string_view had, std::string_view wanted) {
  bool result = false;
  loop::with_measurement(had, [&]<class Had>(std::type_identity<Had>) {
    loop::with_measurement(wanted, [&]<class Wanted>(std::type_identity<Wanted>) {
      result = loop::is_part_of<Wanted, Had>();
    });
  });
  return result;
}

void require_fitting(const logger::RunLog& log, const experiment::Scenario& scenario) {
  const experiment::Scenario& recorded = log.scenario();
  if (scenario.num_joints != recorded.num_joints) {
    refuse(log, "recorded with {} joints, not {}", recorded.num_joints, scenario.num_joints);
  }
  if (scenario.loop.period_s != recorded.loop.period_s) {
    refuse(log, "recorded with another loop.period_s; commands between its ticks cannot be had");
  }
  if (scenario.robot.flexible.has_value() != recorded.robot.flexible.has_value()) {
    refuse(log, "recorded from a robot whose joints are {}; robot.joints must stay so",
           recorded.robot.flexible ? "flexible" : "rigid");
  }
}

void require_measured(const logger::RunLog& log, const loop::LawInfo& law) {
  if (holds(log.info().measurement, law.measurement)) return;
  refuse(log, "law {} needs the measurement {}, which cannot be had from the recorded one, {}",
         law.name, law.measurement, log.info().measurement);
}

class Comparison {
 public:
  Comparison(int num_joints, const OnCompared& on_compared)
      : on_compared_(on_compared), sum_of_squares_(static_cast<std::size_t>(num_joints)) {
    result_.joints.resize(static_cast<std::size_t>(num_joints));
  }

  void add(std::int64_t tick, const robot::Vector& recorded, const robot::Vector& replayed) {
    // Ticks without a command are gaps only when a command follows.
    result_.without_command += pending_;
    if (pending_ != 0 && result_.first_without_command < 0) {
      result_.first_without_command = first_pending_;
    }
    pending_ = 0;
    result_.passed_over += std::exchange(pending_passed_over_, 0);
    bool same = true;
    for (int i = 0; i < static_cast<int>(recorded.size()); ++i) {
      const std::uint64_t ulps = ulps_between(recorded[i], replayed[i]);
      if (ulps != 0) {
        same = false;
        if (!result_.first) result_.first = {tick, i, recorded[i], replayed[i], ulps};
      }
      auto& joint = result_.joints[static_cast<std::size_t>(i)];
      const double difference = std::abs(replayed[i] - recorded[i]);
      if (difference > joint.max || joint.max_tick < 0) {
        joint.max = difference;
        joint.max_tick = tick;
      }
      sum_of_squares_[static_cast<std::size_t>(i)] += difference * difference;
      joint.recorded_peak = std::max(joint.recorded_peak, std::abs(recorded[i]));
      joint.replayed_peak = std::max(joint.replayed_peak, std::abs(replayed[i]));
    }
    ++result_.compared;
    if (!same) ++result_.different;
    result_.last_compared = tick;
    if (on_compared_) on_compared_(tick, recorded, replayed);
  }

  void add_without_command(std::int64_t tick) {
    if (pending_++ == 0) first_pending_ = tick;
  }

  void pass_over() { ++pending_passed_over_; }

  void stop(const std::string& why) { result_.stopped_by = why; }
  void stop_not_finite(std::int64_t tick) {
    result_.not_finite = true;
    stop(fmt::format("the law's torque at tick {} is not finite", tick));
  }

  Replay finish() {
    for (std::size_t i = 0; i < result_.joints.size() && result_.compared > 0; ++i) {
      result_.joints[i].rms = std::sqrt(sum_of_squares_[i] / static_cast<double>(result_.compared));
    }
    return std::move(result_);
  }

 private:
  const OnCompared& on_compared_;
  Replay result_;
  std::vector<double> sum_of_squares_;
  std::uint64_t pending_ = 0;
  std::uint64_t pending_passed_over_ = 0;
  std::int64_t first_pending_ = -1;
};

std::string missing(const logger::RunLog& log, std::int64_t tick, loop::Slot piece) {
  return fmt::format("tick {} has no {}", tick, log.summary().of(piece).channel);
}

/// Whether any tick from the one in `record` on has a command.
bool command_follows(logger::RunLog& log, logger::TickRecord& record) {
  do {
    if (record.command) return true;
  } while (log.next(record));
  return false;
}

/// One law, tick by tick.
template <class Measurement>
class Replayer {
 public:
  Replayer(logger::RunLog& log, const experiment::Scenario& scenario,
           std::unique_ptr<controller::AnyLaw<Measurement>> law, Comparison& comparison)
      : log_(log),
        realtime_(scenario.loop.mode == experiment::Mode::realtime),
        law_(std::move(law)),
        comparison_(comparison) {}

  void run() {
    logger::TickRecord record;
    std::int64_t next = 0;
    while (log_.next(record)) {
      if (realtime_ && !record.command && !record.controller_state) {
        comparison_.pass_over();
        continue;
      }
      const auto measurement = measured<Measurement>(record.measurement);
      // In lockstep every tick counts; in realtime those that the controller acted on.
      const bool jump = !realtime_ && record.tick != next;
      if (jump || !measurement || !record.reference) {
        const bool no_reference = !jump && measurement && !record.reference;
        const std::string gap =
            missing(log_, jump ? next : record.tick,
                    no_reference ? loop::Slot::reference : loop::Slot::measurement);
        // The end of a run that was ended between two messages is no gap.
        if (command_follows(log_, record)) comparison_.stop(gap);
        break;
      }
      next = record.tick + 1;
      if (!step(record, *measurement)) break;
    }
    // What the log has lost is counted to its end.
    while (log_.next(record)) {
    }
  }

 private:
  /// Whether it can go on.
  bool step(const logger::TickRecord& record, const Measurement& measurement) {
    robot::Vector tau;
    try {
      tau = law_->step(record.tick, measurement, *record.reference).command.tau;
    } catch (const std::logic_error& error) {
      // Damaged numbers can be anything, postures without an inertia matrix too.
      comparison_.stop(
          fmt::format("the law cannot be evaluated at tick {}: {}", record.tick, error.what()));
      return false;
    }
    if (!tau.allFinite()) {
      comparison_.stop_not_finite(record.tick);
      return false;
    }
    law_->keep(record.tick);
    if (record.command) {
      comparison_.add(record.tick, record.command->tau, tau);
    } else {
      comparison_.add_without_command(record.tick);
    }
    return true;
  }

  logger::RunLog& log_;
  bool realtime_;
  std::unique_ptr<controller::AnyLaw<Measurement>> law_;
  Comparison& comparison_;
};

}  // namespace

std::uint64_t ulps_between(double a, double b) {
  // Doubles in their order, as integers: negative ones have it reversed.
  const auto place = [](double x) {
    const auto bits = std::bit_cast<std::uint64_t>(x);
    constexpr std::uint64_t sign = std::uint64_t{1} << 63;
    return (bits & sign) != 0 ? ~bits : bits | sign;
  };
  const std::uint64_t from = place(a), to = place(b);
  return from < to ? to - from : from - to;
}

Replay replay(logger::RunLog& log, const experiment::Scenario& scenario,
              controller::ScenarioLaw law, const OnCompared& on_compared) {
  require_fitting(log, scenario);
  require_measured(log, controller::law_info(law));
  log.rewind();
  return std::visit(
      [&]<class Measurement>(std::unique_ptr<controller::AnyLaw<Measurement>> own) {
        Comparison comparison(scenario.num_joints, on_compared);
        Replayer<Measurement>(log, scenario, std::move(own), comparison).run();
        return comparison.finish();
      },
      std::move(law));
}

Replay replay(logger::RunLog& log, const experiment::Scenario& scenario,
              const OnCompared& on_compared) {
  return replay(log, scenario, controller::scenario_law(scenario), on_compared);
}

}  // namespace tachless::replay
