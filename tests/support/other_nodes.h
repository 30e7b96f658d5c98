#pragma once

#include <gtest/gtest.h>

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

#include "bus/subscriptions.h"
#include "bus/transport.h"
#include "messages/wire.h"
#include "session/session.h"
#include "tests/support/members.h"
#include "tests/support/node_outcome.h"

namespace tachless::support {

/// The three other processes of a run, as one node sees them on its bus, and a script of their
/// messages. A step of the script runs when the node has joined and has handled all earlier
/// messages. The plant finishes after the last step.
class OtherNodes : public bus::Transport {
 public:
  static constexpr std::int64_t run = 7;

  OtherNodes(const scenario::Scenario& scenario, messages::Role node)
      : members_(scenario.digest, node, {"loria_ortega_rigid", "POSITION", ""}, run) {}

  /// Returns the membership of one of the others.
  session::Membership& member(messages::Role role) { return members_.of(role); }

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
    members_.handle(stamp, node, now);
    members_.announce(now, [&](std::span<const std::byte> bytes, const std::string& address) {
      waiting_.push_back({"ARM_PARTICIPANT", {bytes.begin(), bytes.end()}, address});
    });
    joined_ = node.roster != messages::PerRole{};
    members_.for_each([&](session::Membership& each) { joined_ = joined_ && each.has_joined(); });
  }

  std::optional<bus::Datagram> receive(base::Clock::time_point deadline) override {
    while (waiting_.empty() && joined_ && !script_.empty()) {
      const auto step = std::move(script_.front());
      script_.pop_front();
      step();
    }
    if (waiting_.empty() && joined_ && !finished_) {
      finished_ = true;
      members_.for_each([](session::Membership& each) {
        each.on_all_ticks_done();
        each.on_finished(base::Clock::now());
      });
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

  bool joined_ = false, finished_ = false;
  messages::Codec<messages::Participant> participants_{messages::Layout{}};
  Members members_;
  std::deque<std::function<void()>> script_;
  std::deque<Message> waiting_;
  bus::Subscriptions channels_;
  Message current_;
};

/// Returns practical_rigid in lockstep with 30 ticks, then with `overrides`.
inline scenario::Scenario thirty_ticks(std::vector<std::string> overrides) {
  overrides.insert(overrides.begin(),
                   {"loop.mode=lockstep", "loop.duration_s=0.03", "loop.give_up_s=5"});
  return scenario::load_scenario(TACHLESS_SOURCE_DIR "/scenarios/practical_rigid.yaml", overrides);
}

/// Runs `node(session)` among the others until it ends.
inline NodeOutcome run_among(OtherNodes& others, const scenario::Scenario& scenario,
                             messages::Role role,
                             const std::function<void(session::Session&)>& node) {
  session::Session session(scenario, others, {.role = role, .wait_s = 10, .instance = 1});
  return outcome_of(session, [&] { node(session); });
}

}  // namespace tachless::support
