#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <variant>

#include "base/failure.h"
#include "controller/law/parts.h"
#include "messages/measurements.h"
#include "scenario/scenario.h"

namespace tachless::controller {

/// Why a step is not kept: the torque, or what is logged, is not finite.
base::Failure not_finite(std::string_view law, const Vector& tau, std::int64_t tick);

/// Why gains that a reference brought are not used.
base::Failure gains_refused(std::string_view gains, std::string_view problem);

/// Result of one step of a law; valid until the next step.
struct Outcome {
  const messages::TorqueCommand& command;
  const messages::LawSignals& signals;
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

  explicit AnyLaw(const scenario::LoopSpec& loop)
      : longest_gap_(
            loop.mode == scenario::Mode::realtime ? std::min(loop.max_missed + 1, most_ticks) : 1) {
  }
  AnyLaw(const AnyLaw&) = delete;
  AnyLaw& operator=(const AnyLaw&) = delete;
  virtual ~AnyLaw() = default;

  [[nodiscard]] virtual std::string_view name() const = 0;
  /// Suffix of the channel that it is fed from.
  [[nodiscard]] virtual std::string_view measurement() const = 0;
  /// Returns the logged signals, in the rows of `Outcome::signals`.
  [[nodiscard]] virtual std::span<const messages::Signal> signals() const = 0;

  /// In realtime the commands that the plant lets be missed in a row, and one; in lockstep 1.
  [[nodiscard]] int longest_gap() const { return longest_gap_; }

  /// The step of `tick`, with the reference's gains where it has other ones than the last: the
  /// memory stays. @throw base::Failure(protective_stop) when the torque, or what is
  /// logged, is not finite, or the gains are none of this law's: the law is of no use from then on.
  /// std::logic_error unless `tick` is later than the last one, std::bad_variant_access for another
  /// type of measurement.
  Outcome step(std::int64_t tick, const messages::AnyMeasurement& measurement,
               const messages::ReferencePoint& reference) {
    const std::int64_t gap = tick - tick_;
    if (gap < 1) throw std::logic_error("controller::AnyLaw: ticks go forward");
    const bool anew = !started_ || gap > longest_gap_;
    if (reference.gains != gains_) {
      retune(reference.gains);
      gains_ = reference.gains;
    }
    compute(tick, measurement, reference, anew ? 0 : static_cast<int>(gap));
    if (!messages::all_finite(command_) || !messages::all_finite(signals_of_step_)) {
      throw not_finite(name(), command_.tau, tick);
    }
    const bool restarted = anew && started_;
    tick_ = tick;
    started_ = true;
    return {command_, signals_of_step_, gap - 1, restarted};
  }

 protected:
  messages::TorqueCommand command_;  ///< of the last step
  messages::LawSignals signals_of_step_;

 private:
  /// Sets both: the step `ticks` periods after the last one; with 0 the first one, from the memory
  /// that the law starts with.
  virtual void compute(std::int64_t tick, const messages::AnyMeasurement& measurement,
                       const messages::ReferencePoint& reference, int ticks) = 0;

  /// Takes other gains (scenario::gains_text; empty: the scenario's) from this step on.
  /// @throw base::Failure(protective_stop) when it cannot
  virtual void retune(std::string_view gains) {
    throw gains_refused(gains, "this law does not change them");
  }

  int longest_gap_;
  std::int64_t tick_ = -1;
  bool started_ = false;
  std::string gains_;  ///< of the last step's reference
};

/// A law of C++ as an AnyLaw, with the friction that the scenario has it feed forward, if any.
template <law::Law L>
class LawWithMemory final : public AnyLaw {
 public:
  /// The law with these gains. @throw base::Failure(bad_usage) when they are none of it
  using Retuned = std::function<L(std::string_view gains)>;

  /// @param retuned none: the gains may not change
  LawWithMemory(L law, const scenario::LoopSpec& loop,
                const controller::FrictionSpec& friction = {}, double lead_s = 0,
                Retuned retuned = {})
      : AnyLaw(loop),
        law_(std::move(law)),
        friction_(friction),
        lead_s_(lead_s),
        retuned_(std::move(retuned)) {}

  [[nodiscard]] std::string_view name() const override { return L::name; }
  [[nodiscard]] std::string_view measurement() const override { return L::Measurement::suffix; }
  [[nodiscard]] std::span<const messages::Signal> signals() const override { return L::signals; }

 private:
  void compute(std::int64_t /*tick*/, const messages::AnyMeasurement& any,
               const messages::ReferencePoint& reference, int ticks) override {
    const auto& measurement = std::get<typename L::Measurement>(any);
    if (ticks == 0) memory_ = law_.start(measurement, reference);
    for (int i = 1; i < ticks; ++i) {
      const double share = static_cast<double>(i) / ticks;
      memory_ = law_.step(memory_, messages::between(measurement_, measurement, share),
                          messages::between(reference_, reference, share))
                    .memory;
    }
    auto step = law_.step(memory_, measurement, reference);
    memory_ = step.memory;
    command_ = step.command;
    signals_of_step_ = step.signals;
    if (friction_.given()) {
      command_.tau += friction_.torque(law::feedforward_ahead(reference, lead_s_).v_ref);
    }
    measurement_ = measurement;
    reference_ = reference;
  }

  void retune(std::string_view gains) override {
    if (!retuned_) throw gains_refused(gains, "controller.gains_may_change is false");
    try {
      law_ = retuned_(gains);
    } catch (const base::Failure& problem) {
      throw gains_refused(gains, problem.what());
    }
  }

  L law_;
  typename L::Memory memory_;
  typename L::Measurement measurement_;
  messages::ReferencePoint reference_;
  controller::FrictionSpec friction_;
  double lead_s_;
  Retuned retuned_;
};

}  // namespace tachless::controller
