#include "viewer/pose_player.h"

#include <algorithm>

#include "diagnostics/time.h"

namespace tachless::viewer {

using diagnostics::seconds_of;

void PosePlayer::add(double t_s, const robot::Vector& q, loop::Clock::time_point now) {
  if (!first_at_) {
    first_at_ = now;
    first_s_ = shown_s_ = t_s;
  } else if (t_s <= poses_.back().t_s) {
    return;
  }
  // The newest makes way for one that is still close to the one before it.
  const std::size_t size = poses_.size();
  if (size >= 2 && t_s - poses_[size - 2].t_s <= interval_s) poses_.pop_back();
  poses_.push_back({t_s, q});
  if (poses_.size() > max_waiting) {
    poses_.pop_front();
    shown_s_ = std::max(shown_s_, poses_.front().t_s);
  }
}

std::optional<PosePlayer::Pose> PosePlayer::at(loop::Clock::time_point now) {
  if (poses_.empty()) return std::nullopt;
  if (shown_at_) {
    shown_s_ = std::min(shown_s_ + seconds_of(now - *shown_at_), poses_.back().t_s);
    shown_at_ = now;
  } else if (may_begin(now)) {
    shown_at_ = now;
  }
  while (poses_.size() >= 2 && poses_[1].t_s <= shown_s_) poses_.pop_front();
  const Pose& before = poses_.front();
  if (poses_.size() == 1 || shown_s_ <= before.t_s) return before;
  const Pose& after = poses_[1];
  const double share = (shown_s_ - before.t_s) / (after.t_s - before.t_s);
  return Pose{shown_s_, before.q + share * (after.q - before.q)};
}

bool PosePlayer::finished() const {
  return complete() && (poses_.empty() || (shown_at_ && shown_s_ >= poses_.back().t_s));
}

bool PosePlayer::complete() const {
  return ended_ || (!poses_.empty() && poses_.back().t_s >= end_s_);
}

bool PosePlayer::may_begin(loop::Clock::time_point now) const {
  const loop::Clock::duration waited = now - *first_at_;
  if (complete() || waited >= longest_wait) return true;
  if (waited < shortest_wait) return false;
  // The rest comes within the time that it takes to show everything.
  const double speed = (poses_.back().t_s - first_s_) / seconds_of(waited);
  return end_s_ - poses_.back().t_s <= speed * (end_s_ - first_s_);
}

}  // namespace tachless::viewer
