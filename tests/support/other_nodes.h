#pragma once

#include <gtest/gtest.h>

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <list>
#include <map>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

#include "bus/subscriptions.h"
#include "bus/transport.h"
#include "messages/wire.h"
#include "session/membership.h"
#include "session/session.h"

namespace tachless::support {

/// The three other processes of a run, as one node sees them on its bus, and a script of their
/// messages. A step of the script runs when the node has joined and has handled all earlier
/// messages. The plant finishes after the last step.
class OtherNodes : public bus::Transport {
 public:
  static constexpr std::int64_t run = 7;

  OtherNodes(const scenario::Scenario& scenario, messages::Role node) {
    for (int i = 0; i < messages::num_roles; ++i) {
      const auto role = static_cast<messages::Role>(i);
      if (role == node) continue;
      session::Membership::Self self;
      self.who.role = role;
      self.who.instance = 100 + i;
      self.who.scenario_digest = scenario.digest;
      self.who.law = role == messages::Role::controller ? "loria_ortega_rigid" : "";
      self.who.measurement = role == messages::Role::controller ? "POSITION" : "";
      self.run = role == messages::Role::plant ? run : 0;
      self.counters_required = false;
      members_.emplace_back(role, session::Membership(self, base::Clock::now()));
    }
  }

  /// Returns the membership of one of the others.
  session::Membership& member(messages::Role role) {
    for (auto& [each, member] : members_) {
      if (each == role) return member;
    }
    throw std::logic_error("the node itself is no other one");
  }

  /// Adds a step to the script.
  void then(std::function<void()> step) { script_.push_back(std::move(step)); }

  /// Sends a message of `from`, or of a stranger with that address.
  template <class Value>
  void send(messages::Port<Value>& port, const messages::Stamp& stamp, const Value& value,
            std::string from = "plant's address") {
    const auto bytes = port.codec.encode(stamp, value);
    waiting_.push_back({port.channel, {bytes.begin(), bytes.end()}, std::move(from)});
  }

  /// The bytes that the node has published on each channel but that of the announcements.
  std::map<std::string, std::vector<std::vector<std::byte>>, std::less<>> published;

  /// Returns the values that the node has published on a port, with their stamps.
  template <class Value>
  std::vector<std::pair<messages::Stamp, Value>> values(const messages::Port<Value>& port) {
    std::vector<std::pair<messages::Stamp, Value>> all;
    for (const auto& bytes : published[port.channel]) {
      auto& [stamp, value] = all.emplace_back();
      EXPECT_EQ(port.codec.decode(bytes, stamp, value), messages::Rejection::none);
    }
    return all;
  }

  int subscribe(const std::string& channel) override { return channels_.add(channel); }

  void publish(std::string_view channel, std::span<const std::byte> payload) override {
    if (channel != "ARM_PARTICIPANT") {
      published[std::string(channel)].emplace_back(payload.begin(), payload.end());
      return;
    }
    messages::Stamp stamp;
    messages::Participant node;
    ASSERT_EQ(participants_.decode(payload, stamp, node), messages::Rejection::none);
    const auto now = base::Clock::now();
    for (auto& [role, member] : members_) member.handle(stamp, node, "node's address", now);
    for (auto& [role, member] : members_) announce(role, member, now);
    joined_ = node.roster != messages::PerRole{};
    for (auto& [role, member] : members_) joined_ = joined_ && member.has_joined();
  }

  std::optional<bus::Datagram> receive(base::Clock::time_point deadline) override {
    while (waiting_.empty() && joined_ && !script_.empty()) {
      const auto step = std::move(script_.front());
      script_.pop_front();
      step();
    }
    if (waiting_.empty() && joined_ && !finished_) {
      finished_ = true;
      for (auto& [role, member] : members_) {
        member.on_all_ticks_done();
        member.on_finished(base::Clock::now());
      }
    }
    if (waiting_.empty()) {
      std::this_thread::sleep_until(deadline);
      return std::nullopt;
    }
    current_ = std::move(waiting_.front());
    waiting_.pop_front();
    return bus::Datagram{.channel = current_.channel,
                         .payload = current_.payload,
                         .sender = current_.sender,
                         .channel_number = channels_.find(current_.channel)};
  }

 private:
  struct Message {
    std::string channel;
    std::vector<std::byte> payload;
    std::string sender;
  };

  void announce(messages::Role role, session::Membership& member, base::Clock::time_point now) {
    const std::string address = std::string(messages::name(role)) + "'s address";
    const auto& own = member.announce(now);
    for (auto& [other_role, other] : members_) {
      if (other_role != role) other.handle(own.stamp, own.participant, address, now);
    }
    const auto bytes = participants_.encode(own.stamp, own.participant);
    waiting_.push_back({"ARM_PARTICIPANT", {bytes.begin(), bytes.end()}, address});
  }

  bool joined_ = false, finished_ = false;
  messages::Codec<messages::Participant> participants_{messages::Layout{}};
  std::list<std::pair<messages::Role, session::Membership>> members_;
  std::deque<std::function<void()>> script_;
  std::deque<Message> waiting_;
  bus::Subscriptions channels_;
  Message current_;
};

/// How a node ended.
struct NodeOutcome {
  base::ExitCode code = base::ExitCode::done;
  std::string fault;
  session::Statistics statistics;
};

/// Runs `node(session)` among the others until it ends.
inline NodeOutcome run_among(OtherNodes& others, const scenario::Scenario& scenario,
                             messages::Role role,
                             const std::function<void(session::Session&)>& node) {
  session::Session session(scenario, others, {.role = role, .wait_s = 10, .instance = 1});
  NodeOutcome outcome;
  try {
    session.guard([&] { node(session); });
  } catch (const base::Failure& failure) {
    outcome.code = failure.code();
    outcome.fault = failure.what();
  }
  outcome.statistics = session.statistics();
  return outcome;
}

}  // namespace tachless::support
