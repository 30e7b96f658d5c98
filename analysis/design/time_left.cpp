#include "design/time_left.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace tachless::design {
namespace {

// Work in steps times loops. Searches for a UR5e, a Z1, an xArm 7, a Gen3 and an SO-101 took these
// means; the UR5e took no rounds and the xArm 7 five.
constexpr double of_scan = 150, of_start = 500, of_climb = 1200, of_rounds = 3200,
                 of_more_range = 2000, of_other_search = 10'000;
// A climb takes this share of its most steps.
constexpr double usual_share = 0.85;

// A step of a search with four variables is cheaper, so that a set of postures is more such steps.
double of_set(bool by_joint) { return by_joint ? 900 : 1400; }
double of_analysis(bool by_joint) { return by_joint ? 600 : 1000; }

}  // namespace

void TimeLeft::enter(Phase phase, int left) {
  here_ = 0;
  ahead_ = of_analysis(by_joint_) + (another_follows_ ? of_other_search : 0);
  if (phase == Phase::range) {
    ahead_ += left * of_set(by_joint_);
    return;
  }
  ahead_ += 2 * of_set(by_joint_) + (by_joint_ ? of_more_range : 0);
  if (phase == Phase::rounds) {
    // Fewer rounds than the most are usual, and late ones find few postures.
    ahead_ += left > 4 ? of_climb : -0.5 * of_more_range * (by_joint_ ? 1 : 0);
    return;
  }
  if (by_joint_) ahead_ += of_rounds;
  if (phase == Phase::second) return;
  ahead_ += is_short_ ? 0 : of_climb;
  if (phase == Phase::best) return;
  ahead_ += of_climb + (is_short_ ? 0 : left * of_start);
  done_ += of_scan;  // of bandwidths for the start
}

void TimeLeft::step(std::size_t loops, int steps_left) {
  const auto each = static_cast<double>(loops);
  done_ += each;
  here_ = usual_share * steps_left * each;
}

void TimeLeft::set() {
  done_ += of_set(by_joint_);
  ahead_ = std::max(0.0, ahead_ - of_set(by_joint_));
}

std::string TimeLeft::text() const {
  const std::chrono::duration<double> so_far = std::chrono::steady_clock::now() - begin_;
  if (done_ == 0) return "the time left is not known yet";
  return fmt::format("about {:.0f} s left", std::ceil(so_far.count() / done_ * (here_ + ahead_)));
}

}  // namespace tachless::design
