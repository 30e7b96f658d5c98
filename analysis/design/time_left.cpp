#include "design/time_left.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace tachless::design {
namespace {

// Work in steps times loops, of searches for eleven arms of six and seven joints. The searches for
// diagonal gains took 5.5 to 27 s of processor time, with no to seven further attempts.
constexpr double of_scan = 150, of_start = 500, of_climb = 1200, of_round = 1000,
                 of_other_least = 5000, of_other_most = 20'000;
constexpr int usual_rounds = 3, usual_attempts = 7;  // at most so many in these searches
// A climb takes this share of its most steps.
constexpr double usual_share = 0.85;
// Ratio of the most to the least up to which the most alone is printed.
constexpr double nearly_one = 1.5;

// A step of a search with four variables is cheaper, so that a set of postures is more such steps.
double of_set(bool by_joint) { return by_joint ? 700 : 1400; }
double of_analysis(bool by_joint) { return by_joint ? 600 : 1000; }

}  // namespace

void TimeLeft::enter(Phase phase, int left) {
  here_ = 0;
  const double end = 2 * of_set(by_joint_) + of_analysis(by_joint_);
  ahead_ = {end, end};
  if (another_follows_) ahead_.add(of_other_least, of_other_most);
  if (by_joint_) {
    const int attempts = phase == Phase::range ? left : usual_attempts;
    ahead_.add(0, attempts * (of_set(true) + of_round));
  }
  if (phase == Phase::range) return;
  if (by_joint_) {
    const int rounds = phase == Phase::rounds ? left : usual_rounds;
    ahead_.add(0, std::min(rounds, usual_rounds) * of_round);
  }
  if (phase == Phase::rounds || phase == Phase::second) return;
  if (!is_short_) ahead_.add(0, of_climb);
  if (phase == Phase::best) return;
  ahead_.add(of_climb, of_climb + (is_short_ ? 0 : left * of_start));
  done_ += of_scan;  // of bandwidths for the start
}

void TimeLeft::step(std::size_t loops, int steps_left) {
  const auto each = static_cast<double>(loops);
  done_ += each;
  here_ = usual_share * steps_left * each;
}

void TimeLeft::set() {
  const double work = of_set(by_joint_);
  done_ += work;
  ahead_.least = std::max(0.0, ahead_.least - work);
  ahead_.most = std::max(ahead_.least, ahead_.most - work);
}

std::string TimeLeft::text() const {
  const std::chrono::duration<double> so_far = std::chrono::steady_clock::now() - begin_;
  if (done_ == 0) return "the time left is not known yet";
  const double each_s = so_far.count() / done_;
  const double least = std::ceil(each_s * (here_ + ahead_.least));
  const double most = std::ceil(each_s * (here_ + ahead_.most));
  if (most <= nearly_one * least) return fmt::format("about {:.0f} s left", most);
  return fmt::format("{:.0f} to {:.0f} s left", least, most);
}

}  // namespace tachless::design
