#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <stdexcept>

#include "base/quantities.h"
#include "messages/signals.h"
#include "plant/encoder.h"
#include "plant/spec.h"

namespace tachless::plant {

/// Torque of the drives over one tick.
struct AppliedTorque {
  Vector tau;                                ///< after the limits [N m; N if prismatic]
  std::array<bool, max_joints> saturated{};  ///< the command exceeded a limit
};

/// The drives of all joints: they limit, delay and hold torques. Copies are independent. Call once
/// a tick, in this order: `accept` if the tick has a command, `applied`, `end_tick`.
///
/// With `command_delay` 0 the command of tick k acts over tick k; `applied` is then read after
/// `accept`. With d > 0 the command acts over tick k + d, and the initial torque over the first d
/// ticks. `applied` may then be read before the command has come. With jitter j the acting command
/// is up to j ticks older; a seeded generator draws its age for each tick. Without a command the
/// last one is held. From tick to tick the torque that is sent changes by at most its rate, from
/// the initial torque on. An arm that adds a torque itself is sent the difference.
class Drive {
 public:
  /// @param spec its limits, jitter and seed are used
  /// @param command_delay [ticks]
  /// @param period_s one tick [s]
  /// @param initial torque of each joint until the first command acts [N m; N if prismatic]
  /// @throw std::logic_error if a delay is not in 0 to `max_delay_ticks` or a limit is not
  /// positive.
  Drive(const DriveSpec& spec, int command_delay, double period_s, const Vector& initial)
      : limit_(spec.torque_limit_Nm.value_or(Vector(Vector::Constant(initial.size(), infinity)))),
        num_slots_(static_cast<std::size_t>(command_delay + spec.command_age_jitter_ticks) + 1),
        jitter_(spec.command_age_jitter_ticks),
        seed_(spec.seed) {
    if (spec.torque_rate_limit_Nm_per_s) change_ = *spec.torque_rate_limit_Nm_per_s * period_s;
    if (std::min(command_delay, jitter_) < 0 ||
        std::max(command_delay, jitter_) > max_delay_ticks) {
      throw std::logic_error("plant::Drive: command_delay is out of range");
    }
    if (!(limit_.array() > 0).all() || !(change_.array() > 0).all()) {
      throw std::logic_error("plant::Drive: torque limits must be positive");
    }
    applied_.tau = initial.cwiseMin(limit_).cwiseMax(-limit_);
    initial_ = before_ = applied_.tau;
    added_ = Vector::Zero(limit_.size());
    accepted_.fill(applied_);
  }

  /// Takes the command of this tick. Precondition: a finite torque of each joint.
  /// @throw std::logic_error if it is not; nothing changes then.
  void accept(const messages::TorqueCommand& command) {
    if (command.tau.size() != limit_.size() || !command.tau.allFinite()) {
      throw std::logic_error("plant::Drive: a command needs a finite torque of each joint");
    }
    if (stopped_) return;
    for (Eigen::Index i = 0; i < limit_.size(); ++i) {
      const double tau = command.tau[i];
      const bool saturated = std::abs(tau) > limit_[i];
      accepted_[now_].saturated[static_cast<std::size_t>(i)] = saturated;
      accepted_[now_].tau[i] = saturated ? std::copysign(limit_[i], tau) : tau;
    }
    act();
  }

  /// Takes the torque that the arm itself adds over this tick [N m; N]: call it before `applied`
  /// is read. Until the first call the arm adds none.
  void set_added(const Vector& added) {
    if (stopped_) return;
    added_ = added;
    if (tick_ == 0) before_ = initial_ - added_;
    act();
  }

  /// Returns the torque to send over this tick: `applied` without what the arm adds.
  [[nodiscard]] Vector sent() const { return applied_.tau - added_; }

  /// Returns the torque held over this tick.
  [[nodiscard]] const AppliedTorque& applied() const { return applied_; }

  void end_tick() {
    shift();
    before_ = sent();
    ++tick_;
    act();
  }

  /// Lets ticks pass in which nothing was sent and the robot held the last torque. Call it between
  /// `end_tick` and `applied`.
  void skip(std::int64_t ticks) {
    const auto shifts = std::min(ticks, static_cast<std::int64_t>(num_slots_));
    for (std::int64_t i = 0; i < shifts; ++i) shift();
    tick_ += ticks;
    act();
  }

  /// Makes the protective stop: gives no torque from now on, whatever is accepted. The arm brakes.
  void stop() {
    stopped_ = true;
    applied_.tau.setZero();
    applied_.saturated = {};
    before_.setZero();
    added_.setZero();
    accepted_.fill(applied_);
  }

 private:
  /// Begins the next slot with the last command.
  void shift() {
    const std::size_t last = now_;
    now_ = (now_ + 1) % num_slots_;
    accepted_[now_] = accepted_[last];
  }

  void act() {
    // The oldest slot was accepted command_delay + jitter ticks ago.
    const auto younger =
        jitter_ == 0 ? 0 : static_cast<std::size_t>((jitter_ + 1) * standard_uniform(seed_, tick_));
    applied_ = accepted_[(now_ + 1 + younger) % num_slots_];
    for (Eigen::Index i = 0; i < change_.size(); ++i) {
      const double wanted = applied_.tau[i] - added_[i] - before_[i];
      if (std::abs(wanted) <= change_[i]) continue;
      applied_.tau[i] = before_[i] + std::copysign(change_[i], wanted) + added_[i];
      applied_.saturated[static_cast<std::size_t>(i)] = true;
    }
  }

  Vector limit_;           ///< [N m; N if prismatic]
  Vector change_;          ///< that is possible from one tick to the next [N m; N]; empty: any
  std::size_t num_slots_;  ///< command_delay + jitter + 1
  int jitter_;
  std::uint64_t seed_;
  std::int64_t tick_ = 0;
  bool stopped_ = false;
  /// A ring of accepted torques: this tick's at `now_`, behind it the oldest that may act, from
  /// command_delay + jitter ticks ago.
  std::array<AppliedTorque, 2 * max_delay_ticks + 1> accepted_;
  std::size_t now_ = 0;
  AppliedTorque applied_;
  Vector initial_;
  Vector added_;   ///< by the arm, over this tick
  Vector before_;  ///< torque sent over the tick before
};

}  // namespace tachless::plant
