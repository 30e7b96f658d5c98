// After the first ticks, no node allocates. Each is given again what it heard in a real run, with
// announcements that answer its own. The plant is not among them: Simbody's integrators allocate in
// every step.
#include <gtest/gtest.h>

#include "bus/subscriptions.h"
#include "controller/node.h"
#include "logger/node.h"
#include "messages/wire.h"
#include "reference/node.h"
#include "tests/support/counting_new.h"
#include "tests/system/four_threads.h"

namespace tachless::system_test {
namespace {

using messages::Role;

struct Heard {
  std::string channel;
  std::vector<std::byte> payload;
  std::string sender;
};

/// Notes what a node receives.
class Recorder : public bus::Transport {
 public:
  Recorder(std::unique_ptr<bus::Transport> inner, std::vector<Heard>& heard)
      : inner_(std::move(inner)), heard_(heard) {}
  int subscribe(const std::string& channel) override { return inner_->subscribe(channel); }
  void publish(std::string_view channel, std::span<const std::byte> payload) override {
    inner_->publish(channel, payload);
  }
  std::optional<bus::Datagram> receive(base::Clock::time_point deadline) override {
    const auto datagram = inner_->receive(deadline);
    if (datagram) {
      heard_.push_back({std::string(datagram->channel),
                        {datagram->payload.begin(), datagram->payload.end()},
                        std::string(datagram->sender)});
    }
    return datagram;
  }

 private:
  std::unique_ptr<bus::Transport> inner_;
  std::vector<Heard>& heard_;
};

/// Gives it to a node again, and counts what the node allocates between the first ticks and the
/// last: the run's middle three fifths.
class Replay : public bus::Transport {
 public:
  Replay(Role role, const std::vector<Heard>& heard)
      : role_(static_cast<std::size_t>(role)), heard_(heard) {}
  int subscribe(const std::string& channel) override { return channels_.add(channel); }
  void publish(std::string_view channel, std::span<const std::byte> payload) override {
    if (!channel.ends_with("_PARTICIPANT")) return;
    const std::size_t so_far = allocations;
    messages::Stamp stamp;
    EXPECT_EQ(codec_.decode(payload, stamp, own_), messages::Rejection::none);
    before_ += allocations - so_far;  // not the node's
  }
  std::optional<bus::Datagram> receive(base::Clock::time_point /*deadline*/) override {
    const std::size_t begin = heard_.size() / 5;
    const std::size_t end = heard_.size() * 4 / 5;
    // Others' heartbeats hold texts; they come ten times a second, not every tick.
    while (next_ > begin && next_ < end && heard_[next_].channel.ends_with("_PARTICIPANT")) ++next_;
    if (next_ == begin) before_ = allocations;
    if (next_ >= end && !counted_) counted_ = allocations - before_;
    if (next_ >= heard_.size()) throw base::Failure(base::ExitCode::interrupted, "all replayed");
    const Heard& each = heard_[next_++];
    if (!each.channel.ends_with("_PARTICIPANT")) {
      return datagram(each, each.payload);
    }
    messages::Stamp stamp;
    messages::Participant who;
    EXPECT_EQ(codec_.decode(each.payload, stamp, who), messages::Rejection::none);
    who.heard_instance[role_] = own_.instance;
    who.heard_counter[role_] = own_.counter;
    if (who.roster[role_] != 0) who.roster[role_] = own_.instance;
    return datagram(each, codec_.encode(stamp, who));
  }
  [[nodiscard]] std::optional<std::size_t> counted() const { return counted_; }

 private:
  [[nodiscard]] bus::Datagram datagram(const Heard& heard,
                                       std::span<const std::byte> payload) const {
    return {.channel = heard.channel,
            .payload = payload,
            .sender = heard.sender,
            .channel_number = channels_.find(heard.channel)};
  }

  bus::Subscriptions channels_;
  std::size_t role_;
  const std::vector<Heard>& heard_;
  messages::Participant own_;
  messages::Codec<messages::Participant> codec_{messages::Layout{}};
  std::size_t next_ = 0;
  std::size_t before_ = 0;
  std::optional<std::size_t> counted_;
};

class NoNode : public testing::TestWithParam<Role> {};

TEST_P(NoNode, AllocatesAfterTheFirstTicks) {
  const Role role = GetParam();
  const scenario::Scenario scenario =
      system_test::scenario("practical_rigid", {"loop.duration_s=0.5"});
  std::vector<Heard> heard;
  {
    FourThreads threads(scenario);
    threads.wrap([&](Role each, std::unique_ptr<bus::Transport> inner) {
      if (each != role) return inner;
      return std::unique_ptr<bus::Transport>(new Recorder(std::move(inner), heard));
    });
    ASSERT_EQ(threads.finish().complaints(), "");
  }
  const FourThreads elsewhere(scenario);  // for its log's path
  Replay replay(role, heard);
  session::Session session(
      scenario, replay,
      {.role = role, .run_id = {}, .wait_s = 60, .interrupted = nullptr, .instance = 0});
  try {
    switch (role) {
      case Role::reference:
        reference::run_node(scenario, session);
        break;
      case Role::controller:
        controller::run_node(scenario, controller::scenario_law(scenario), session);
        break;
      case Role::logger:
        logger::run_node(scenario, session, elsewhere.log_path());
        break;
      case Role::plant:
        FAIL();
    }
  } catch (const base::Failure& failure) {
    EXPECT_EQ(std::string(failure.what()), "all replayed");
  }
  EXPECT_EQ(session.statistics().ticks, scenario.loop.num_ticks);
  EXPECT_EQ(replay.counted(), std::optional<std::size_t>(0));
}

INSTANTIATE_TEST_SUITE_P(Each, NoNode,
                         testing::Values(Role::reference, Role::controller, Role::logger),
                         [](const auto& role) { return std::string(messages::name(role.param)); });

}  // namespace
}  // namespace tachless::system_test
