#pragma once

#include <chrono>
#include <cstddef>
#include <string>

namespace tachless::design {

/// Estimate of the time that a search still takes. The unit of work is one step of the search
/// (gain_search.h) for one loop. Rounds, second starts and further attempts come only where gains
/// lack the margin at other postures: the estimate has a least and a most. The remaining work of
/// each phase is assumed equal to that of searches for published arms of six and seven joints.
class TimeLeft {
 public:
  /// Phases of a search, in order: local searches from several starts; longer ones from the best
  /// and the second best of these; rounds with worse postures added; attempts to find no worse
  /// posture in the joints' range.
  enum class Phase { starts, best, second, rounds, range };

  /// @param by_joint whether each joint's gains are variables; such a search repeats in rounds
  /// @param another_follows whether a search for diagonal gains follows
  /// @param is_short whether the search has one start alone
  TimeLeft(bool by_joint, bool another_follows, bool is_short)
      : by_joint_(by_joint), another_follows_(another_follows), is_short_(is_short) {}

  /// Begins a phase.
  /// @param left most parts of this phase that may follow the present one
  void enter(Phase phase, int left = 0);
  /// Records a step of the search that evaluated `loops` loops.
  /// @param steps_left most steps that may follow in the present local search
  void step(std::size_t loops, int steps_left);
  /// Records a set of postures in the joints' range.
  void set();

  /// Returns e.g. "about 12 s left", "10 to 30 s left".
  [[nodiscard]] std::string text() const;

 private:
  /// Work that follows, at least and at most.
  struct Work {
    double least = 0, most = 0;
    void add(double more_least, double more_most) {
      least += more_least;
      most += more_most;
    }
  };
  bool by_joint_, another_follows_, is_short_;
  double done_ = 0;  ///< work
  double here_ = 0;  ///< work left in the present local search
  Work ahead_;       ///< work after the present local search
  std::chrono::steady_clock::time_point begin_ = std::chrono::steady_clock::now();
};

}  // namespace tachless::design
