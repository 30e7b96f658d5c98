#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <stdexcept>
#include <string_view>
#include <utility>
#include <variant>

#include "controller/law/law.h"
#include "diagnostics/failure.h"
#include "experiment/scenario.h"
#include "loop/measurements.h"

namespace tachless::controller {

/// Why a step is not kept: the torque, or what is logged, is not finite.
diagnostics::Failure not_finite(std::string_view law, const robot::Vector& tau, std::int64_t tick);

/// What one step of a law gave; valid until its next one.
struct Outcome {
  const loop::TorqueCommand& command;
  const loop::LawSignals& signals;
  std::int64_t skipped = 0;  ///< ticks passed over since the last step, or since tick 0
  bool restarted = false;    ///< too many: the memory began anew
};

/// A law with its memory over the ticks of one run, behind one interface, so that whatever steps
/// laws is compiled once and not once per law: what the node does, and what a replay of its log has
/// to do. The law itself is given its own type of measurement and no other. Knows no bus.
///
/// In realtime ticks may be passed over, and a filter that took two periods for one would see twice
/// the velocity: after a gap of m ticks a law steps m times, along a straight line from the last
/// measurement and reference to the new ones (exact for the first-order hold, which takes the error
/// for a ramp between samples). After more than `longest_gap` ticks the memory is of no use any
/// more and starts anew.
class AnyLaw {
 public:
  /// Bound of `longest_gap`, however many missed commands the plant tolerates.
  static constexpr int most_ticks = 64;

  explicit AnyLaw(const experiment::LoopSpec& loop)
      : longest_gap_(loop.mode == experiment::Mode::realtime
                         ? std::min(loop.max_missed + 1, most_ticks)
                         : 1) {}
  AnyLaw(const AnyLaw&) = delete;
  AnyLaw& operator=(const AnyLaw&) = delete;
  virtual ~AnyLaw() = default;

  [[nodiscard]] virtual std::string_view name() const = 0;
  /// Suffix of the channel that it is fed from.
  [[nodiscard]] virtual std::string_view measurement() const = 0;
  /// What it logs, in the rows of `Outcome::signals`.
  [[nodiscard]] virtual std::span<const loop::Signal> signals() const = 0;

  /// In realtime the commands that the plant lets be missed in a row, and one; in lockstep 1.
  [[nodiscard]] int longest_gap() const { return longest_gap_; }

  /// The step of `tick`. Nothing is remembered before `keep`, so a step may be discarded.
  /// @throw std::logic_error unless `tick` is later than the one kept last,
  /// std::bad_variant_access for another type of measurement than the law's.
  Outcome step(std::int64_t tick, const loop::AnyMeasurement& measurement,
               const loop::ReferencePoint& reference) {
    const std::int64_t gap = tick - tick_;
    if (gap < 1) throw std::logic_error("controller::AnyLaw: ticks go forward");
    const bool anew = !started_ || gap > longest_gap_;
    compute(tick, measurement, reference, anew ? 0 : static_cast<int>(gap));
    return {command_, signals_of_step_, gap - 1, anew && started_};
  }

  /// `tick` was the last step's, and counts.
  void keep(std::int64_t tick) {
    keep_memory();
    tick_ = tick;
    started_ = true;
  }

  /// Both. @throw diagnostics::Failure(protective_stop) when the torque, or what is logged, is not
  /// finite; the step is not kept then.
  Outcome advance(std::int64_t tick, const loop::AnyMeasurement& measurement,
                  const loop::ReferencePoint& reference) {
    const Outcome outcome = step(tick, measurement, reference);
    if (!loop::all_finite(outcome.command) || !loop::all_finite(outcome.signals)) {
      throw not_finite(name(), outcome.command.tau, tick);
    }
    keep(tick);
    return outcome;
  }

 protected:
  loop::TorqueCommand command_;  ///< of the last step
  loop::LawSignals signals_of_step_;

 private:
  /// Sets both: the step `ticks` periods after the one that was kept last, whose memory is not
  /// changed; with 0 the first one, from the memory that the law starts with.
  virtual void compute(std::int64_t tick, const loop::AnyMeasurement& measurement,
                       const loop::ReferencePoint& reference, int ticks) = 0;
  /// The memory becomes that after the last step.
  virtual void keep_memory() {}

  int longest_gap_;
  std::int64_t tick_ = -1;
  bool started_ = false;
};

/// A law of C++ as an AnyLaw.
template <law::Law L>
class LawWithMemory final : public AnyLaw {
 public:
  LawWithMemory(L law, const experiment::LoopSpec& loop) : AnyLaw(loop), law_(std::move(law)) {}

  [[nodiscard]] std::string_view name() const override { return L::name; }
  [[nodiscard]] std::string_view measurement() const override { return L::Measurement::suffix; }
  [[nodiscard]] std::span<const loop::Signal> signals() const override { return L::signals; }

 private:
  void compute(std::int64_t /*tick*/, const loop::AnyMeasurement& any,
               const loop::ReferencePoint& reference, int ticks) override {
    const auto& measurement = std::get<typename L::Measurement>(any);
    next_ = ticks == 0 ? law_.start(measurement, reference) : memory_;
    for (int i = 1; i < ticks; ++i) {
      const double share = static_cast<double>(i) / ticks;
      next_ = law_.step(next_, loop::between(measurement_, measurement, share),
                        loop::between(reference_, reference, share))
                  .memory;
    }
    auto step = law_.step(next_, measurement, reference);
    next_ = step.memory;
    command_ = step.command;
    signals_of_step_ = step.signals;
    next_measurement_ = measurement;
    next_reference_ = reference;
  }
  void keep_memory() override {
    memory_ = next_;
    measurement_ = next_measurement_;
    reference_ = next_reference_;
  }

  L law_;
  typename L::Memory memory_, next_;
  typename L::Measurement measurement_, next_measurement_;
  loop::ReferencePoint reference_, next_reference_;
};

}  // namespace tachless::controller
