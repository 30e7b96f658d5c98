#pragma once

#include <functional>
#include <initializer_list>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "bus/authenticated.h"
#include "experiment/scenario.h"
#include "loop/clock.h"
#include "loop/messages.h"
#include "node/session.h"
#include "protocol/membership.h"

namespace tachless::node {

/// Notices, while a process waits for the others, that it is on a bus with another key than theirs
/// (or that only one side has one): announcements come, and none of them verifies. Verifies nothing
/// itself.
class KeyCheck {
 public:
  KeyCheck(loop::Role own_role, bool has_key) : own_role_(own_role), has_key_(has_key) {}

  /// An announcement that verified: the keys agree.
  void accepted() { accepted_ = true; }
  /// One that did not, though it is an announcement.
  void foreign(const bus::Stranger& stranger, loop::Clock::time_point now);
  /// @throw Failure(protocol_violated) when only foreign ones have been heard for 1.5 s.
  void poll(loop::Clock::time_point now) const;

 private:
  loop::Role own_role_;
  bool has_key_;
  bool accepted_ = false;
  int num_foreign_ = 0;
  std::string first_;  ///< the first foreign one, in words
  loop::Clock::time_point since_;
};

/// One process's part in a run under way: carries out over a transport what protocol::Membership
/// decides. Sends and decodes announcements, authenticates the bus if there is a key, tells the
/// user who is missing. Decides nothing about who takes part.
class Link final : public Session {
 public:
  struct Config {
    loop::Role role = loop::Role::plant;
    std::optional<std::int64_t> run_id = {};  ///< plant only; default: microseconds since 1970
    double wait_s = 0;                        ///< for the others at the start; 0 = unlimited
    /// Set when the user wants the process to end.
    const std::atomic<bool>* interrupted = nullptr;
    std::int64_t instance = 0;         ///< tells two processes of one role apart; 0: a random one
    std::optional<bus::Key> key = {};  ///< of the bus
    bool resume = false;               ///< controller only: join a run under way, to take over
  };

  /// Subscribes to the participants' channel.
  Link(const experiment::Scenario& scenario, bus::Transport& transport, const Config& config);

  /// What is known of the four.
  protocol::Membership& membership() { return *membership_; }

  void join(const loop::LawInfo& law, const Handler& other) override;
  [[nodiscard]] std::int64_t run() const override { return membership_->run(); }
  void started(loop::Clock::time_point now) override;
  void poll(loop::Clock::time_point now) override;
  [[nodiscard]] loop::Clock::time_point next_poll() const override {
    return membership_->next_announcement();
  }
  Handled handle(const bus::Datagram& datagram) override;
  void handle_pending() override;
  void progressed(std::int64_t tick, double error_norm = 0) override {
    membership_->progressed(tick, error_norm);
  }
  void complete() override { membership_->complete(); }
  [[nodiscard]] bool finished() const override { return membership_->plant_finished(); }
  /// The plant waits until the others have finished too, or have been silent for too long; the
  /// others until all have and the plant knows of their own end, a second at most.
  /// @throw Failure when one of them has failed at the last moment
  void leave() override;

  /// This process will end with `failure`, and tells the others at once, but has to bring the robot
  /// to rest before it does.
  void stopping(const diagnostics::Failure& failure, loop::Clock::time_point now);
  /// This process ends with `failure`: tells the others now, though it still has to conclude, and
  /// returns what it tells; valid until the next announcement.
  std::span<const std::byte> ending(const diagnostics::Failure& failure);
  /// That announcements travel on.
  [[nodiscard]] const std::string& channel() const { return channel_; }
  /// The announcement alone, if it is due: for a process that is ending.
  void announce_if_due(loop::Clock::time_point now) {
    if (now >= next_poll()) announce(now);
  }

  [[nodiscard]] std::int64_t tick_of(loop::Role role) const override {
    return membership_->tick_of(role);
  }
  /// Which of these roles have been silent for a second, in words; all of them, if none has.
  [[nodiscard]] std::string silent_among(std::initializer_list<loop::Role> roles) const;
  [[nodiscard]] std::string describe(loop::Role role) const override {
    return membership_->describe(role);
  }
  /// Whether a message may be the role's holder's: on a bus with a key it is one of the four's,
  /// from wherever it comes (their announcements may have been passed on by others); without one it
  /// is when it comes from the holder's address.
  [[nodiscard]] bool is_from(loop::Role role, std::string_view sender) const {
    return transport_.has_key() || membership_->is_from(role, sender);
  }
  [[nodiscard]] bool knows(std::string_view sender) const override {
    return membership_->knows(sender);
  }
  /// Datagrams dropped because they did not verify under the key.
  [[nodiscard]] std::int64_t unauthenticated() const { return transport_.dropped(); }

 private:
  void announce_fault(const diagnostics::Failure& failure) override;
  std::span<const std::byte> announce(loop::Clock::time_point now);
  void announce_repeatedly();
  /// Or until it is `over`.
  void handle_until(loop::Clock::time_point deadline, const std::function<bool()>& over);
  void tell_who_is_missing(loop::Clock::time_point now);

  std::string channel_;
  protocol::Membership::Self self_;
  std::optional<protocol::Membership> membership_;
  bus::Codec<loop::Participant> codec_;
  loop::Stamp stamp_;       ///< of the last announcement heard
  loop::Participant peer_;  ///< its content
  KeyCheck key_check_;
  loop::PerRole entered_{};  ///< roster of the session that the bus has entered
  loop::Clock::time_point next_notice_;
};

}  // namespace tachless::node
