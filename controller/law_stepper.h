#pragma once

#include <algorithm>
#include <cstdint>
#include <memory>
#include <stdexcept>
#include <utility>

#include "controller/any_law.h"
#include "experiment/scenario.h"

namespace tachless::controller {

/// A law over the ticks of one run: what the node does, and what a replay of its log has to do.
/// In realtime ticks may be passed over, and a filter that took two periods for one would see twice
/// the velocity: the step after a gap of m ticks is told m (exact for the first-order hold, which
/// takes the error for a ramp between samples). After more than `longest_gap` ticks the memory is
/// of no use any more and starts anew.
template <class Measurement>
class LawStepper {
 public:
  /// Bound of `longest_gap`, however many missed commands the plant tolerates.
  static constexpr int most_ticks = 64;

  struct Outcome {
    typename AnyLaw<Measurement>::Output output;  ///< valid until the next step
    std::int64_t skipped = 0;  ///< ticks passed over since the last step, or since tick 0
    bool restarted = false;    ///< too many: the memory began anew
  };

  LawStepper(std::unique_ptr<AnyLaw<Measurement>> law, const experiment::LoopSpec& loop)
      : law_(std::move(law)),
        longest_gap_(loop.mode == experiment::Mode::realtime
                         ? std::min(loop.max_missed + 1, most_ticks)
                         : 1) {}

  [[nodiscard]] const AnyLaw<Measurement>& law() const { return *law_; }

  /// In realtime the commands that the plant lets be missed in a row, and one; in lockstep 1.
  [[nodiscard]] int longest_gap() const { return longest_gap_; }

  /// The step of `tick`. Nothing is remembered before `keep`, so a step may be discarded.
  /// @throw std::logic_error unless `tick` is later than the one kept last.
  Outcome step(std::int64_t tick, const Measurement& measurement,
               const loop::ReferencePoint& reference) {
    const std::int64_t gap = tick - tick_;
    if (gap < 1) throw std::logic_error("controller::LawStepper: ticks go forward");
    if (!started_ || gap > longest_gap_) {
      return {law_->start(tick, measurement, reference), gap - 1, started_};
    }
    return {law_->step(tick, measurement, reference, static_cast<int>(gap)), gap - 1};
  }

  /// `tick` was the last step's, and counts.
  void keep(std::int64_t tick) {
    law_->keep();
    tick_ = tick;
    started_ = true;
  }

 private:
  std::unique_ptr<AnyLaw<Measurement>> law_;
  int longest_gap_;
  std::int64_t tick_ = -1;
  bool started_ = false;
};

}  // namespace tachless::controller
