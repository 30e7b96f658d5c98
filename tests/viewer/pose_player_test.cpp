#include "viewer/pose_player.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <stdexcept>

namespace tachless::viewer {
namespace {

using Time = loop::Clock::time_point;

Time at(double seconds) {
  return Time{} + std::chrono::hours(1) +
         std::chrono::duration_cast<loop::Clock::duration>(std::chrono::duration<double>(seconds));
}

robot::Vector q(double value) { return robot::Vector::Constant(1, value); }

/// A run of `end_s` at `speed` times the wall clock, 1 kHz; q is the simulated time.
class Playing {
 public:
  Playing(double end_s, double speed) : player_(end_s), end_s_(end_s), speed_(speed) {}

  /// The pose shown at the wall-clock time `now_s` since the run began.
  double shown(double now_s) {
    for (; next_ * 1e-3 <= std::min(end_s_, speed_ * now_s); ++next_) {
      player_.add(next_ * 1e-3, q(next_ * 1e-3), at(next_ * 1e-3 / speed_));
    }
    const auto pose = player_.at(at(now_s));
    EXPECT_TRUE(pose.has_value());
    EXPECT_NEAR(pose->q[0], pose->t_s, 1e-12);  // interpolation of a straight line, rounding
    return pose->t_s;
  }

  /// How long the run is shown; where, on the way, the pace was not the simulated one, in s.
  struct Show {
    double begin_s = 0, end_s = 0, off_pace_s = 0;
  };
  Show watch() {
    constexpr double frame_s = 0.03;
    Show show;
    double before_s = 0;
    for (double now_s = 0; !player_.finished(); now_s += frame_s) {
      const double t_s = shown(now_s);
      if (t_s == 0) show.begin_s = now_s;
      // Between its first movement and its last each frame is as long as on the wall clock.
      if (before_s > 0 && t_s < end_s_) show.off_pace_s += std::abs(t_s - before_s - frame_s);
      before_s = t_s;
      show.end_s = now_s;
      if (now_s > 1000) throw std::runtime_error("never ends");
    }
    return show;
  }

  PosePlayer& player() { return player_; }

 private:
  PosePlayer player_;
  double end_s_, speed_;
  int next_ = 0;
};

constexpr double rounding = 1e-6;  // of some hundred times to whole nanoseconds
constexpr double one_frame_s = 0.03;

TEST(PosePlayer, ShowsNothingBeforeTheFirstPose) {
  PosePlayer player(1);
  EXPECT_FALSE(player.at(at(0)).has_value());
  EXPECT_FALSE(player.finished());
  player.add(0, q(3), at(0));
  EXPECT_EQ(player.at(at(0))->q[0], 3);
}

TEST(PosePlayer, ShowsAFastRunAtTheSimulatedPaceToItsEnd) {
  const auto show = Playing(5, 10).watch();
  EXPECT_LE(show.begin_s, 0.2 + one_frame_s);
  EXPECT_NEAR(show.end_s - show.begin_s, 5, 2 * one_frame_s);
  EXPECT_LT(show.off_pace_s, rounding);
}

TEST(PosePlayer, ShowsARunOnTheWallClockAtOnce) {
  const auto show = Playing(10, 1).watch();
  EXPECT_LE(show.begin_s, 0.2 + one_frame_s);
  EXPECT_LT(show.off_pace_s, rounding);
}

TEST(PosePlayer, WaitsForARunThatIsSlowUntilItWillNotHaveToWaitAgain) {
  // 2 s that take 4 s: shown from 2 s on.
  const auto show = Playing(2, 0.5).watch();
  EXPECT_NEAR(show.begin_s, 2, 2 * one_frame_s);
  EXPECT_LT(show.off_pace_s, 2 * one_frame_s);
}

TEST(PosePlayer, ShowsALongSlowRunAsItComes) {
  Playing playing(100, 0.1);
  EXPECT_EQ(playing.shown(2.9), 0);
  playing.shown(3.01);
  EXPECT_GT(playing.shown(3.2), 0);
  // It has caught up, and moves on with the newest pose, never beyond.
  for (int i = 50; i < 100; ++i) EXPECT_NEAR(playing.shown(0.1 * i), 0.01 * i, 1e-3);
}

TEST(PosePlayer, EndsWhereARunThatFailedStopped) {
  PosePlayer player(100);
  for (int k = 0; k <= 1000; ++k) player.add(1e-3 * k, q(0), at(0));
  player.end();
  for (double now_s = 0; now_s < 0.99; now_s += 0.03) {
    player.at(at(now_s));
    EXPECT_FALSE(player.finished());
  }
  EXPECT_NEAR(player.at(at(1.1))->t_s, 1, rounding);
  EXPECT_TRUE(player.finished());
}

TEST(PosePlayer, EndsAtOnceWhenARunNeverBegan) {
  PosePlayer player(100);
  player.end();
  EXPECT_TRUE(player.finished());
}

TEST(PosePlayer, PassesOverPosesThatComeTwiceOrLate) {
  PosePlayer player(1);
  player.add(0, q(0), at(0));
  player.add(1, q(1), at(0));
  player.add(1, q(7), at(0));
  player.add(0.5, q(7), at(0));
  player.at(at(0));
  EXPECT_NEAR(player.at(at(0.5))->q[0], 0.5, rounding);
  EXPECT_EQ(player.at(at(2))->q[0], 1);
}

TEST(PosePlayer, KeepsWhatIsNeededForThirtyPicturesASecond) {
  PosePlayer player(10);
  for (int k = 0; k <= 200'000; ++k) player.add(5e-5 * k, q(std::sin(5e-5 * k)), at(0));
  EXPECT_LE(player.waiting(), 400U);
  player.at(at(0));
  for (double t_s = 0.01; t_s < 10; t_s += 0.01) {
    // A chord of 1/30 s below an arc of curvature 1: (1/30)^2 / 8.
    EXPECT_NEAR(player.at(at(t_s))->q[0], std::sin(t_s), 1.4e-4);
  }
}

TEST(PosePlayer, LeavesOutTheOldestWhenAnHourWaits) {
  PosePlayer player(1e6);
  player.at(at(0));
  for (int k = 0; k <= 200'000; ++k) player.add(0.05 * k, q(0), at(0));
  EXPECT_EQ(player.waiting(), PosePlayer::max_waiting);
  EXPECT_GT(player.at(at(10))->t_s, 4000);
}

}  // namespace
}  // namespace tachless::viewer
