#pragma once

#include <algorithm>
#include <cstdint>
#include <optional>
#include <stdexcept>
#include <vector>

#include "controller/catalogue.h"
#include "controller/law/law.h"
#include "experiment/scenario.h"

namespace tachless::controller {

/// A law over the ticks of one run, its memory included: what the node does, and what a replay of
/// its log has to do. In realtime ticks may be passed over, and a filter that took two periods for
/// one would see twice the velocity: the step after a gap of m ticks is that of the law sampled
/// every m periods (exact for the first-order hold, whose error is a ramp between samples). After
/// more than `longest_gap` ticks the memory says nothing any more and starts anew.
template <law::Law L>
class LawStepper {
 public:
  using Measurement = typename L::Measurement;

  /// The laws for all gaps up to the most that the plant tolerates, `max_missed` + 1, or up to this
  /// many; for a lockstep scenario only the one.
  static constexpr int most_laws = 64;

  struct Outcome {
    law::Step<typename L::Memory> step;
    std::int64_t skipped = 0;  ///< ticks passed over since the last step, or since tick 0
    bool restarted = false;    ///< too many: the memory began anew
  };

  /// @throw diagnostics::Failure(bad_usage) as `make_law`.
  explicit LawStepper(const experiment::Scenario& scenario) {
    const bool realtime = scenario.loop.mode == experiment::Mode::realtime;
    const int count = realtime ? std::min(scenario.loop.max_missed + 1, most_laws) : 1;
    laws_.reserve(static_cast<std::size_t>(count));
    for (int ticks = 1; ticks <= count; ++ticks) laws_.push_back(make_law<L>(scenario, ticks));
  }

  [[nodiscard]] int longest_gap() const { return static_cast<int>(laws_.size()); }

  /// The step of `tick`. Nothing is remembered before `keep`, so a step may be thrown away.
  /// @throw std::logic_error unless `tick` is later than the one kept last.
  [[nodiscard]] Outcome step(std::int64_t tick, const Measurement& measurement,
                             const loop::ReferencePoint& reference) const {
    const L& usual = laws_.front();
    const std::int64_t gap = tick - tick_;
    if (gap < 1) throw std::logic_error("controller::LawStepper: ticks go forward");
    if (!memory_ || gap > longest_gap()) {
      return {usual.step(usual.start(measurement, reference), measurement, reference), gap - 1,
              memory_.has_value()};
    }
    const L& law = laws_[static_cast<std::size_t>(gap - 1)];
    return {law.step(*memory_, measurement, reference), gap - 1};
  }

  void keep(std::int64_t tick, const typename L::Memory& memory) {
    tick_ = tick;
    memory_ = memory;
  }

 private:
  std::vector<L> laws_;  ///< [m - 1]: for steps m ticks after the last one
  std::int64_t tick_ = -1;
  std::optional<typename L::Memory> memory_;  ///< nothing before the first step
};

}  // namespace tachless::controller
