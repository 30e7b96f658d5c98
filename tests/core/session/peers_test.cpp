#include "session/peers.h"

#include <gtest/gtest.h>

#include <set>

namespace tachless::session {
namespace {

using namespace std::chrono_literals;
using messages::Role;

constexpr std::int64_t own = 5;

/// The peers of a plant.
class APlantsPeers : public testing::Test {
 protected:
  messages::Participant announce() {
    messages::Participant mine;
    peers.fill_acknowledgements(mine, false, now);
    return mine;
  }
  static messages::Participant who(std::int64_t instance, std::int64_t counter,
                                   Role role = Role::logger) {
    messages::Participant result;
    result.instance = instance;
    result.counter = counter;
    result.role = role;
    return result;
  }
  static messages::Participant answering(std::int64_t instance, std::int64_t counter,
                                         std::int64_t answered) {
    messages::Participant result = who(instance, counter);
    result.heard_instance[0] = own;
    result.heard_counter[0] = answered;
    return result;
  }
  bool remember(const messages::Participant& said, const std::string& sender = "address") {
    return peers.remember({}, said, sender, peers.answered(said, now), now).first;
  }

  Peers::Time now{1s};
  Peers peers{Role::plant, own, true};
};

TEST_F(APlantsPeers, ProveThatTheyLiveByAnsweringOneOfTheLastAnnouncements) {
  EXPECT_FALSE(peers.answered(answering(7, 1, 0), now));
  const auto first = now;
  announce();
  now += 100ms;
  EXPECT_EQ(peers.answered(answering(7, 1, 1), now), first);
  EXPECT_FALSE(peers.answered(answering(7, 1, 2), now)) << "not sent yet";
  EXPECT_FALSE(peers.answered(answering(7, 1, -3), now));
  messages::Participant other = answering(7, 1, 1);
  other.heard_instance[0] = own + 1;
  EXPECT_FALSE(peers.answered(other, now)) << "it answers an earlier process";
  other.heard_instance = {0, own, own, own};
  EXPECT_FALSE(peers.answered(other, now)) << "it answers other roles";
  for (std::int64_t i = 1; i < Peers::answerable; ++i) announce();
  EXPECT_TRUE(peers.answered(answering(7, 1, 1), now));
  announce();
  EXPECT_FALSE(peers.answered(answering(7, 1, 1), now)) << "too long ago";
}

TEST_F(APlantsPeers, AreKnownByCountersThatRise) {
  announce();
  EXPECT_TRUE(peers.is_new(who(7, 3)));
  remember(who(7, 3));
  EXPECT_FALSE(peers.is_new(who(7, 3)));
  EXPECT_FALSE(peers.is_new(who(7, 2)));
  EXPECT_TRUE(peers.is_new(who(7, 4)));
  EXPECT_TRUE(peers.is_new(who(8, 1)));
}

TEST_F(APlantsPeers, AreBelievedOnlyWhatProvesSomething) {
  announce();
  EXPECT_TRUE(remember(who(7, 1), "a stranger's address"));
  EXPECT_EQ(peers.find(Role::logger), nullptr);
  messages::Participant said = answering(7, 2, 1);
  said.host = "arm-1";
  EXPECT_TRUE(remember(said)) << "the first proof is news";
  ASSERT_NE(peers.find(Role::logger), nullptr);
  EXPECT_EQ(peers.find(Role::logger)->sender, "address") << "not the one that repeated it";
  said = who(7, 3);
  said.host = "elsewhere";
  EXPECT_FALSE(remember(said));
  EXPECT_EQ(peers.find(Role::logger)->participant.host, "arm-1");
}

TEST_F(APlantsPeers, AreInNoRunUntilTheyHaveProvenSomething) {
  announce();
  messages::Stamp stamp;
  stamp.run = 77;
  const auto run_of = [&](const messages::Participant& said) {
    return peers.remember(stamp, said, "address", peers.answered(said, now), now).peer.run;
  };
  EXPECT_EQ(run_of(who(7, 1)), 0);
  EXPECT_EQ(run_of(answering(7, 2, 1)), 77);
}

TEST_F(APlantsPeers, LivedWhenTheAnswerWasAskedForNotWhenItCame) {
  const auto asked = now;
  announce();
  now += 900ms;
  announce();
  remember(answering(7, 1, 1));
  EXPECT_EQ(peers.find(Role::logger)->lived, asked);
  remember(answering(7, 2, 2));
  EXPECT_EQ(peers.find(Role::logger)->lived, now);
  remember(answering(7, 3, 1));
  EXPECT_EQ(peers.find(Role::logger)->lived, now) << "what it proved once it has proved";
  peers.excuse(60s);
  EXPECT_EQ(peers.find(Role::logger)->lived, now + 60s);
  EXPECT_EQ(peers.answered(answering(7, 4, 2), now), now + 60s);
}

TEST_F(APlantsPeers, AreNotForgottenForThisProcessesOwnSilence) {
  remember(who(7, 1));
  now += 2 * Peers::forgotten_after;
  peers.excuse(2 * Peers::forgotten_after);
  peers.forget_silent(now + Peers::forgotten_after - 1ms);
  EXPECT_EQ(peers.all().size(), 1);
  peers.forget_silent(now + Peers::forgotten_after);
  EXPECT_TRUE(peers.all().empty());
}

TEST_F(APlantsPeers, AreNamedSoThatEachCanProveItself) {
  announce();
  remember(answering(7, 1, 1));
  for (const std::int64_t stranger : {20, 21, 22}) remember(who(stranger, 9));
  int proven = 0;
  std::set<std::int64_t> others;
  for (int i = 0; i < 12; ++i) {
    const messages::Participant mine = announce();
    const std::int64_t named = mine.heard_instance[3];
    EXPECT_EQ(mine.heard_counter[3], named == 7 ? 1 : 9);
    if (named == 7) {
      ++proven;
    } else {
      others.insert(named);
    }
  }
  EXPECT_EQ(proven, 6) << "every other time";
  EXPECT_EQ(others, (std::set<std::int64_t>{20, 21, 22}));
  peers.set_holder(Role::logger, 7);
  messages::Participant last;
  for (int i = 0; i < 2; ++i) {
    peers.fill_acknowledgements(last, true, now);
    EXPECT_EQ(last.heard_instance[3], 7) << "what ends the run is for the run's members";
  }
}

TEST_F(APlantsPeers, AreNotDrivenOutByAFloodOfRecordings) {
  announce();
  remember(answering(7, 1, 1));
  for (std::int64_t i = 0; i < 100'000; ++i) remember(who(1000 + i, 1));
  ASSERT_NE(peers.find(Role::logger), nullptr);
  EXPECT_LE(peers.all().size(), 32U);
  now += 2s;
  peers.set_holder(Role::logger, 7);
  peers.forget_silent(now);
  EXPECT_EQ(peers.all().size(), 1U) << "a holder stays";
  peers.forget(7);
  EXPECT_EQ(peers.all().size(), 1U);
}

}  // namespace
}  // namespace tachless::session
