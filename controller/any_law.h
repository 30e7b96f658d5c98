#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <optional>
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

/// Returns the failure for a step whose torque or logged signals are not finite.
base::Failure not_finite(std::string_view law, const Vector& tau, std::int64_t tick);

/// Returns the failure for gains of a reference that the law cannot use, with the reason.
base::Failure gains_refused(std::string_view gains, std::string_view problem);

/// Result of one step of a law; valid until the next step.
struct Outcome {
  const messages::TorqueCommand& command;
  const messages::LawSignals& signals;
  std::int64_t skipped = 0;  ///< ticks without a step since the last step, or since tick 0
  bool restarted = false;    ///< the gap exceeded `longest_gap`, and the memory started again
};

/// A law with its memory over the ticks of one run, behind one interface. Code that steps laws,
/// such as the node and the replay of its log, is thereby compiled once instead of once per law. A
/// law receives its own type of measurement only. The class knows no bus.
///
/// In realtime, ticks may be missed. A filter that took two periods for one would see twice the
/// velocity. After a gap of m ticks the law therefore steps m times. The measurement and the
/// reference of these steps lie on a straight line from the last values to the new ones. This
/// interpolation is exact for the first-order hold, which assumes an error that is linear between
/// samples. After more than `longest_gap` ticks the memory starts again.
class AnyLaw {
 public:
  /// Upper bound of `longest_gap`, whatever number of missed commands the plant tolerates.
  static constexpr int most_ticks = 64;

  explicit AnyLaw(const scenario::LoopSpec& loop)
      : longest_gap_(
            loop.mode == scenario::Mode::realtime ? std::min(loop.max_missed + 1, most_ticks) : 1) {
  }
  AnyLaw(const AnyLaw&) = delete;
  AnyLaw& operator=(const AnyLaw&) = delete;
  virtual ~AnyLaw() = default;

  [[nodiscard]] virtual std::string_view name() const = 0;
  /// Returns the suffix of the channel that carries the law's measurements.
  [[nodiscard]] virtual std::string_view measurement() const = 0;
  /// Returns the logged signals, in the rows of `Outcome::signals`.
  [[nodiscard]] virtual std::span<const messages::Signal> signals() const = 0;

  /// Returns, in realtime, one more than the number of consecutive missed commands that the plant
  /// tolerates, at most `most_ticks`. Returns 1 in lockstep.
  [[nodiscard]] int longest_gap() const { return longest_gap_; }

  /// Builds the law with the gains of `reference`, ahead of the step that uses this reference. The
  /// call is optional and makes that step faster.
  /// @throw base::Failure(protective_stop) if the law cannot use the gains.
  void prepare(const messages::ReferencePoint& reference) {
    if (reference.gains == gains_ || reference.gains == prepared_) return;
    prepared_.reset();
    build(reference.gains);
    prepared_ = reference.gains;
  }

  /// Computes the step of `tick`. If the reference's gains differ from the last ones, the law takes
  /// the new gains and keeps its memory.
  /// @throw base::Failure(protective_stop) if the torque or a logged signal is not finite, or if
  /// the law cannot use the gains. The law must not be stepped again afterwards.
  /// @throw std::logic_error unless `tick` is later than the last one.
  /// @throw std::bad_variant_access for another type of measurement.
  Outcome step(std::int64_t tick, const messages::AnyMeasurement& measurement,
               const messages::ReferencePoint& reference) {
    const std::int64_t gap = tick - tick_;
    if (gap < 1) throw std::logic_error("controller::AnyLaw: ticks go forward");
    const bool anew = !started_ || gap > longest_gap_;
    if (reference.gains != gains_) {
      prepare(reference);
      retune();
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
  messages::TorqueCommand command_;  ///< command of the last step [N m; N]
  messages::LawSignals signals_of_step_;

 private:
  /// Computes the step `ticks` periods after the last one into `command_` and `signals_of_step_`.
  /// With 0 it computes the first step, from the law's start memory.
  virtual void compute(std::int64_t tick, const messages::AnyMeasurement& measurement,
                       const messages::ReferencePoint& reference, int ticks) = 0;

  /// Builds the law with other gains, for `retune`. `gains` has the form of scenario::gains_text;
  /// an empty text selects the scenario's gains.
  /// @throw base::Failure(protective_stop) if the law cannot use these gains.
  virtual void build(std::string_view gains) {
    throw gains_refused(gains, "this law does not change them");
  }
  /// Uses the law that `build` made, from this step on. It is called after `build`, possibly
  /// several times.
  virtual void retune() {}

  int longest_gap_;
  std::int64_t tick_ = -1;
  bool started_ = false;
  std::string gains_;                    ///< gains of the last step's reference
  std::optional<std::string> prepared_;  ///< gains of the last call of `build`
};

/// Adapter of a C++ law to `AnyLaw`. It adds the friction feed-forward of the scenario, if any.
template <law::Law L>
class LawWithMemory final : public AnyLaw {
 public:
  /// Builds the law with these gains.
  /// @throw base::Failure(bad_usage) if the law cannot use these gains.
  using Retuned = std::function<L(std::string_view gains)>;

  /// Returns the friction that is fed forward beside the law [N m; N].
  using Friction = std::function<Vector(const messages::ReferencePoint&)>;

  /// @param friction empty if none is fed forward
  /// @param retuned empty if the gains may not change.
  LawWithMemory(L law, const scenario::LoopSpec& loop, Friction friction = {}, Retuned retuned = {})
      : AnyLaw(loop),
        law_(std::move(law)),
        friction_(std::move(friction)),
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
    if (friction_) command_.tau += friction_(reference);
    measurement_ = measurement;
    reference_ = reference;
  }

  void build(std::string_view gains) override {
    if (!retuned_) throw gains_refused(gains, "controller.gains_may_change is false");
    try {
      next_.emplace(retuned_(gains));
    } catch (const base::Failure& problem) {
      throw gains_refused(gains, problem.what());
    }
  }

  void retune() override { law_ = *next_; }

  L law_;
  std::optional<L> next_;  ///< law that `build` made
  typename L::Memory memory_;
  typename L::Measurement measurement_;
  messages::ReferencePoint reference_;
  Friction friction_;
  Retuned retuned_;
};

}  // namespace tachless::controller
