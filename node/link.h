#pragma once

#include <functional>
#include <initializer_list>
#include <optional>
#include <span>
#include <string>

#include "bus/authenticated.h"
#include "bus/key.h"
#include "experiment/scenario.h"
#include "node/key_check.h"
#include "node/session.h"
#include "protocol/membership.h"

namespace tachless::node {

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

  /// What the node's own messages are to be sent and received by.
  bus::Transport& transport() { return authenticated_ ? *authenticated_ : raw_; }

  void join(const loop::LawInfo& law, const Handler& other) override;
  [[nodiscard]] std::int64_t run() const override { return membership_->run(); }
  /// What the controller has announced of its law.
  [[nodiscard]] loop::LawInfo law() const { return membership_->law(); }
  void started(loop::Clock::time_point now) override;
  void poll(loop::Clock::time_point now) override;
  [[nodiscard]] loop::Clock::time_point next_poll() const override {
    return membership_->next_announcement();
  }
  bool handle(const bus::Datagram& datagram) override;
  void handle_pending() override;
  void progressed(std::int64_t tick, double error_norm = 0) override {
    membership_->progressed(tick, error_norm);
  }
  void complete() override { membership_->complete(); }
  /// Lockstep: the plant tells with its end what TRUTH it has published; the others are told.
  void published(std::int64_t truth_digest) { membership_->published(truth_digest); }
  [[nodiscard]] std::int64_t truth_digest() const { return membership_->truth_digest(); }
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
  /// Whether another's announcement ends this process: `poll` will throw.
  [[nodiscard]] bool failed() const { return membership_->failure().has_value(); }
  /// The announcement alone, if it is due: for a process that is ending.
  void announce_if_due(loop::Clock::time_point now) {
    if (now >= next_poll()) announce(now);
  }

  /// How often another controller has taken over from one that died.
  [[nodiscard]] int takeovers() const { return membership_->takeovers(); }
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
    return authenticated_ || membership_->is_from(role, sender);
  }
  [[nodiscard]] bool knows(std::string_view sender) const override {
    return membership_->knows(sender);
  }
  /// Datagrams dropped because they did not verify under the key.
  [[nodiscard]] std::int64_t unauthenticated() const {
    return authenticated_ ? authenticated_->dropped() : 0;
  }

 private:
  void announce_fault(const diagnostics::Failure& failure) override;
  std::span<const std::byte> announce(loop::Clock::time_point now);
  void announce_repeatedly();
  void handle_until(loop::Clock::time_point deadline);
  void wait_for_predecessor();
  void announce_until(const std::function<bool()>& known);
  void log_members() const;
  void tell_who_is_missing(loop::Clock::time_point now);

  bus::Transport& raw_;
  std::optional<bus::Authenticated> authenticated_;
  loop::Role role_;
  bool resume_;
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
