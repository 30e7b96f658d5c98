#pragma once

#include <cstdint>
#include <list>
#include <stdexcept>
#include <string>
#include <utility>

#include "messages/wire.h"
#include "session/membership.h"

namespace tachless::support {

/// The memberships of the three processes of a run beside one node.
class Members {
 public:
  using Time = base::Clock::time_point;

  /// @param digest of the scenario
  /// @param law of the controller
  /// @param run of the plant
  Members(std::int64_t digest, messages::Role node, const messages::LawInfo& law,
          std::int64_t run = 0)
      : nodes_address_(address(node)) {
    for (int i = 0; i < messages::num_roles; ++i) {
      const auto role = static_cast<messages::Role>(i);
      if (role == node) continue;
      session::Membership::Self self;
      self.who.role = role;
      self.who.instance = 100 + i;
      self.who.scenario_digest = digest;
      if (role == messages::Role::controller) static_cast<messages::LawInfo&>(self.who) = law;
      self.run = role == messages::Role::plant ? run : 0;
      self.counters_required = false;
      members_.emplace_back(role, session::Membership(self, base::Clock::now()));
    }
  }

  static std::string address(messages::Role role) {
    return std::string(messages::name(role)) + "'s address";
  }

  session::Membership& of(messages::Role role) {
    for (auto& [each, member] : members_) {
      if (each == role) return member;
    }
    throw std::logic_error("the node itself is no other one");
  }

  /// Calls `f` with each membership.
  template <class F>
  void for_each(const F& f) {
    for (auto& [role, member] : members_) f(member);
  }

  /// Hands the node's announcement to each member.
  void handle(const messages::Stamp& stamp, const messages::Participant& node, Time now) {
    for_each([&](session::Membership& each) { each.handle(stamp, node, nodes_address_, now); });
  }

  /// Makes each member announce itself to the others, and to the node by `send(bytes, address)`.
  template <class Send>
  void announce(Time now, const Send& send) {
    for (auto& [role, member] : members_) {
      const auto& own = member.announce(now);
      for (auto& [other_role, other] : members_) {
        if (other_role != role) other.handle(own.stamp, own.participant, address(role), now);
      }
      send(codec_.encode(own.stamp, own.participant), address(role));
    }
  }

 private:
  std::string nodes_address_;
  messages::Codec<messages::Participant> codec_{messages::Layout{}};
  std::list<std::pair<messages::Role, session::Membership>> members_;
};

}  // namespace tachless::support
