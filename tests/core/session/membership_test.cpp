#include "session/membership.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <random>
#include <string>
#include <vector>

namespace tachless::session {
namespace {

using namespace std::chrono_literals;
using messages::ParticipantState;
using messages::Role;
using testing::AllOf;
using testing::HasSubstr;

constexpr std::int64_t plants_run = 77;

/// Processes that hear each other over a network in virtual time; the network may lose
/// announcements.
class Network {
 public:
  struct Process {
    Role role;
    std::string name;
    std::unique_ptr<Membership> membership;
    bool dead = false;  ///< ended, with or without an announcement
  };

  explicit Network(double loss = 0, std::uint64_t seed = 1) : loss_(loss), random_(seed) {}

  /// Starts a process now.
  Membership& start(Role role, std::int64_t instance, std::int64_t digest = 5,
                    std::optional<std::chrono::nanoseconds> wait_limit = {}) {
    Membership::Self self;
    self.who.role = role;
    self.who.instance = instance;
    self.who.scenario_digest = digest;
    self.who.pid = static_cast<std::int32_t>(instance);
    self.who.host = "arm-1";
    self.who.scenario = "scenario_" + std::to_string(digest);
    self.who.measurement = role == Role::controller ? "POSITION" : "";
    self.run = role == Role::plant ? next_run : 0;
    self.wait_limit = wait_limit;
    self.counters_required = counters_required;
    processes_.push_back({role, std::string(messages::name(role)) + std::to_string(instance),
                          std::make_unique<Membership>(self, now_)});
    return *processes_.back().membership;
  }

  std::int64_t next_run = plants_run;  ///< run of the plants started from now on
  bool counters_required = true;       ///< value for the processes started from now on

  void kill(const Membership& victim) { of(victim).dead = true; }

  /// Lets time pass. A failed process announces its fault some times and then ends.
  void pass(std::chrono::nanoseconds duration) {
    const auto end = now_ + duration;
    for (; now_ < end; now_ += 5ms) {
      for (std::size_t i = 0; i < processes_.size(); ++i) step(processes_[i]);
    }
  }

  std::chrono::nanoseconds elapsed() const { return now_ - Membership::Time{}; }
  Membership::Time now() const { return now_; }

 private:
  Process& of(const Membership& which) {
    return *std::ranges::find_if(
        processes_, [&](const Process& each) { return each.membership.get() == &which; });
  }

  void step(Process& process) {
    if (process.dead) return;
    Membership& mine = *process.membership;
    mine.poll(now_);
    if (mine.failure()) {
      for (int i = 0; i < 5; ++i) broadcast(process);
      process.dead = true;
      return;
    }
    if (process.role == Role::plant && mine.has_joined()) mine.on_started(now_);
    if (now_ >= mine.next_announcement()) broadcast(process);
  }

  void broadcast(Process& from) {
    const auto said = from.membership->announce(now_);
    for (Process& to : processes_) {
      if (&to == &from || to.dead) continue;
      if (std::uniform_real_distribution<double>()(random_) < loss_) continue;
      to.membership->handle(said.stamp, said.participant, from.name, now_);
      const bool plant_runs = said.participant.role == Role::plant &&
                              said.participant.state == ParticipantState::running;
      if (plant_runs && to.membership->has_joined() && !to.membership->failure() &&
          to.membership->run() == said.stamp.run) {
        to.membership->on_started(now_);  // the first request would have this effect
      }
    }
  }

  double loss_;
  std::mt19937_64 random_;
  Membership::Time now_{};
  std::vector<Process> processes_;
};

/// Makes `said` a new announcement that answers the last announcement of `whom`.
void answer(Membership::Announcement& said, Membership& whom, Membership::Time now) {
  const messages::Participant asked = whom.announce(now).participant;
  const auto role = static_cast<std::size_t>(asked.role);
  ++said.participant.counter;
  said.participant.heard_instance[role] = asked.instance;
  said.participant.heard_counter[role] = asked.counter;
}

base::ExitCode code(const Membership& process) {
  return process.failure() ? process.failure()->code() : base::ExitCode::done;
}
std::string text(const Membership& process) {
  return process.failure() ? process.failure()->what() : "";
}

TEST(AMembership, FormsInEveryOrderOfStarting) {
  std::vector<Role> order = {Role::plant, Role::reference, Role::controller, Role::logger};
  do {
    Network network;
    std::vector<const Membership*> all;
    for (const Role role : order) {
      EXPECT_EQ(std::ranges::count_if(all, [](auto* each) { return each->is_running(); }), 0);
      all.push_back(&network.start(role, static_cast<std::int64_t>(all.size()) + 1));
      network.pass(700ms);
    }
    for (const auto* each : all) {
      EXPECT_TRUE(each->is_running());
      EXPECT_EQ(each->run(), plants_run);
      EXPECT_EQ(text(*each), "");
    }
  } while (std::ranges::next_permutation(order).found);
}

TEST(AMembership, IsQuickWhenAllAreThere) {
  Network network;
  auto& plant = network.start(Role::plant, 1);
  auto& reference = network.start(Role::reference, 2);
  auto& controller = network.start(Role::controller, 3);
  auto& logger = network.start(Role::logger, 4);
  network.pass(50ms);
  EXPECT_TRUE(plant.is_running());
  EXPECT_TRUE(reference.has_joined() && controller.has_joined() && logger.has_joined());
  EXPECT_EQ(plant.law().measurement, "POSITION");
  EXPECT_EQ(logger.law().measurement, "POSITION");
}

TEST(AMembership, SucceedsUnderLoss) {
  for (std::uint64_t seed = 0; seed < 200; ++seed) {
    Network network(0.3, seed);
    auto& plant = network.start(Role::plant, 1);
    network.start(Role::reference, 2);
    network.start(Role::controller, 3);
    network.start(Role::logger, 4);
    network.pass(5s);
    EXPECT_TRUE(plant.is_running()) << seed;
    network.pass(20s);
    EXPECT_EQ(text(plant), "") << seed;
  }
}

TEST(AMembership, TellsWhoIsMissing) {
  Network network;
  auto& plant = network.start(Role::plant, 1);
  network.start(Role::logger, 2);
  network.pass(1s);
  EXPECT_THAT(plant.missing(), testing::ElementsAre("reference", "controller"));
  network.pass(1h);
  EXPECT_EQ(text(plant), "");
}

TEST(AMembership, WaitsNoLongerThanAllowed) {
  Network network;
  auto& plant = network.start(Role::plant, 1, 5, 2s);
  network.start(Role::logger, 2);
  network.pass(1900ms);
  EXPECT_EQ(code(plant), base::ExitCode::done);
  network.pass(200ms);
  EXPECT_EQ(code(plant), base::ExitCode::peer_lost);
  EXPECT_THAT(text(plant), HasSubstr("waited 2 s for reference, controller"));
}

TEST(AMembership, OfDifferentScenariosIsRefusedByBothSides) {
  for (const double loss : {0.0, 0.3}) {
    Network network(loss);
    auto& plant = network.start(Role::plant, 1, 5);
    auto& controller = network.start(Role::controller, 2, 6);
    network.pass(1s);
    EXPECT_EQ(code(plant), base::ExitCode::bad_usage);
    EXPECT_EQ(code(controller), base::ExitCode::bad_usage);
    EXPECT_THAT(text(plant),
                HasSubstr("the controller (process 2 on arm-1, controller2) runs scenario "
                          "'scenario_6' (digest 0000000000000006), this plant runs scenario "
                          "'scenario_5' (digest 0000000000000005)"));
    EXPECT_THAT(text(controller), HasSubstr("this controller runs scenario 'scenario_6'"));
  }
}

TEST(AMembership, ThatRunsIgnoresANewcomerWithAnotherScenario) {
  Network network;
  auto& plant = network.start(Role::plant, 1);
  network.start(Role::reference, 2);
  auto& controller = network.start(Role::controller, 3);
  network.start(Role::logger, 4);
  network.pass(1s);
  ASSERT_TRUE(plant.is_running());
  auto& outsider = network.start(Role::logger, 5, 6);
  network.pass(3s);
  EXPECT_NE(code(outsider), base::ExitCode::done);
  EXPECT_EQ(text(plant), "");
  EXPECT_EQ(text(controller), "");
}

TEST(AMembership, RefusesASecondHolderOfARoleAndLeavesTheFirstAlone) {
  for (const std::int64_t instance : {1, 9}) {  // smaller and larger than the first's
    for (const bool all_there : {false, true}) {
      Network network;
      auto& first = network.start(Role::controller, 5);
      std::vector<Membership*> others = {&first};
      if (all_there) {
        others.push_back(&network.start(Role::plant, 2));
        others.push_back(&network.start(Role::reference, 3));
        others.push_back(&network.start(Role::logger, 4));
      }
      network.pass(2s);
      auto& second = network.start(Role::controller, instance);
      network.pass(2s);
      EXPECT_EQ(code(second), base::ExitCode::protocol_violated);
      EXPECT_THAT(text(second),
                  AllOf(HasSubstr("there is already the controller (process 5 on arm-1, "
                                  "controller5)"),
                        HasSubstr("--isolate"), HasSubstr("--lcm-url")));
      for (const auto* each : others) EXPECT_EQ(text(*each), "");
      EXPECT_EQ(first.is_running(), all_there);
    }
  }
}

TEST(AMembership, LeavesExactlyOneOfSeveralThatStartTogether) {
  for (std::uint64_t seed = 0; seed < 300; ++seed) {
    std::mt19937_64 random(seed);
    Network network(seed % 2 == 0 ? 0 : 0.3, seed);
    auto& plant = network.start(Role::plant, 50);
    network.start(Role::reference, 51);
    network.start(Role::logger, 52);
    std::vector<Membership*> controllers;
    for (int i = 0; i < 3; ++i) {
      controllers.push_back(&network.start(
          Role::controller, static_cast<std::int64_t>(random() % 1000) * 10 + i + 100));
      network.pass(std::chrono::milliseconds(random() % 500));
    }
    network.pass(4s);
    int left = 0;
    for (const auto* each : controllers) {
      left += each->failure() ? 0 : 1;
      if (!each->failure()) continue;
      EXPECT_EQ(code(*each), base::ExitCode::protocol_violated);
    }
    EXPECT_EQ(left, 1) << seed;
    EXPECT_TRUE(plant.is_running()) << seed;
    EXPECT_EQ(text(plant), "") << seed;
  }
}

class ARunningMembership : public testing::Test {
 protected:
  void SetUp() override {
    network.pass(1s);
    ASSERT_TRUE(plant.is_running());
  }
  Network network;
  Membership& plant = network.start(Role::plant, 1);
  Membership& reference = network.start(Role::reference, 2);
  Membership& controller = network.start(Role::controller, 3);
  Membership& logger = network.start(Role::logger, 4);
};

TEST_F(ARunningMembership, EndsForAllWhenOneIsInterrupted) {
  controller.on_failed(base::Failure(base::ExitCode::interrupted, "interrupted"), network.now());
  network.pass(200ms);
  for (const auto* each : {&plant, &reference, &logger}) {
    EXPECT_EQ(code(*each), base::ExitCode::peer_lost);
    EXPECT_THAT(text(*each), HasSubstr("interrupted"));
  }
  EXPECT_THAT(text(plant), HasSubstr("ended because of the controller (process 3"));
}

TEST_F(ARunningMembership, PassesOnTheExitCodeOfAFault) {
  for (const base::ExitCode fault : {base::ExitCode::protective_stop}) {
    plant.on_failed(base::Failure(fault, "joint 1 ran away"), network.now());
    network.pass(200ms);
    for (const auto* each : {&controller, &reference, &logger}) {
      EXPECT_EQ(code(*each), fault);
      EXPECT_THAT(text(*each), HasSubstr("joint 1 ran away"));
    }
  }
}

TEST_F(ARunningMembership, NoticesAPeerThatDies) {
  network.kill(reference);
  network.pass(4900ms);
  EXPECT_EQ(text(plant), "");
  network.pass(300ms);
  EXPECT_EQ(code(plant), base::ExitCode::peer_lost);
  EXPECT_THAT(text(plant), HasSubstr("the reference (process 2 on arm-1, reference2) has been "
                                     "silent for 5 s"));
  EXPECT_EQ(code(logger), base::ExitCode::peer_lost);
}

TEST_F(ARunningMembership, NoticesAPlantThatDies) {
  network.kill(plant);
  network.pass(5200ms);
  for (const auto* each : {&controller, &reference, &logger}) {
    EXPECT_EQ(code(*each), base::ExitCode::peer_lost);
    EXPECT_THAT(text(*each), HasSubstr("the plant"));
  }
}

TEST(AMembership, BelievesNoRosterOfAPlantThatIsNotInIt) {
  Network network;
  auto& plant = network.start(Role::plant, 1);
  auto& controller = network.start(Role::controller, 3);
  network.pass(1s);
  auto said = plant.announce(network.now());
  said.participant.roster = {9, 2, 3, 4};
  answer(said, controller, network.now());
  controller.handle(said.stamp, said.participant, "plant1", network.now());
  EXPECT_FALSE(controller.has_joined()) << "a plant of which nothing is heard cannot be missed";
}

TEST_F(ARunningMembership, IgnoresFaultsFromOutsideTheRun) {
  Network elsewhere;
  auto& other = elsewhere.start(Role::controller, 90);
  other.on_failed(base::Failure(base::ExitCode::interrupted, "interrupted"), network.now());
  auto said = other.announce(network.now());
  said.stamp.run = 1234;
  answer(said, plant, network.now());
  plant.handle(said.stamp, said.participant, "somebody", network.now());
  said.stamp.run = plants_run;  // in the plant's run, but not the controller of the start
  answer(said, plant, network.now());
  plant.handle(said.stamp, said.participant, "somebody", network.now());
  EXPECT_EQ(text(plant), "");
}

TEST_F(ARunningMembership, YieldsToNobodyOutsideItsRun) {
  auto said = plant.announce(network.now());
  said.stamp.run = plants_run + 1;
  said.stamp.utime = 1'000'000'000;  // older than all other processes
  said.participant.instance = 0x5eed;
  said.participant.state = messages::ParticipantState::running;
  answer(said, plant, network.now());
  plant.handle(said.stamp, said.participant, "somebody", network.now());
  EXPECT_EQ(text(plant), "");
}

TEST_F(ARunningMembership, YieldsToNoRivalThatOnlyClaimsARoster) {
  auto said = plant.announce(network.now());
  said.participant.instance = 0x5eed;
  said.participant.roster = {0x5eed, 2, 3, 4};
  for (const std::int64_t utime : {std::int64_t{0}, messages::Stamp::max_utime}) {
    said.stamp.utime = utime;
    answer(said, plant, network.now());
    EXPECT_FALSE(plant.handle(said.stamp, said.participant, "somebody", network.now()));
    EXPECT_EQ(text(plant), "") << utime;
  }
}

TEST_F(ARunningMembership, BelievesOnlyMembersThatAnswerWithSomethingNew) {
  const auto believed = [&](const Membership::Announcement& said) {
    return logger.handle(said.stamp, said.participant, "controller3", network.now());
  };
  auto said = controller.announce(network.now());
  answer(said, logger, network.now());
  EXPECT_TRUE(believed(said));
  EXPECT_FALSE(believed(said)) << "a copy";
  ++said.participant.counter;
  said.participant.heard_instance = {11, 12, 13, 14};
  EXPECT_FALSE(believed(said)) << "it answers a logger of an earlier session";
  said.participant.state = ParticipantState::fault;
  ++said.participant.counter;
  EXPECT_FALSE(believed(said)) << "a recorded end";
  EXPECT_EQ(text(logger), "");
  said.participant.state = ParticipantState::running;
  said.participant.instance = 0x5eed;
  answer(said, logger, network.now());
  EXPECT_FALSE(believed(said)) << "no member";
}

TEST_F(ARunningMembership, EndsWhenAllHaveFinished) {
  for (auto* each : {&reference, &controller, &logger}) each->on_all_ticks_done();
  plant.on_finished(network.now());
  EXPECT_FALSE(plant.have_all_finished());
  network.pass(200ms);
  EXPECT_TRUE(controller.has_plant_finished() && reference.has_plant_finished() &&
              logger.has_plant_finished());
  controller.on_finished(network.now());
  reference.on_finished(network.now());
  network.pass(200ms);
  EXPECT_FALSE(plant.have_all_finished());
  logger.on_finished(network.now());
  network.pass(200ms);
  EXPECT_TRUE(plant.have_all_finished());
}

TEST_F(ARunningMembership, DoesNotBelieveThatItIsOverBeforeItsLastTick) {
  auto said = plant.announce(network.now());
  said.participant.state = ParticipantState::finished;
  answer(said, controller, network.now());
  controller.handle(said.stamp, said.participant, "plant1", network.now());
  EXPECT_FALSE(controller.has_plant_finished());
  network.pass(2s);
  EXPECT_EQ(text(controller), "") << "the plant is heard to be running";
  controller.on_all_ticks_done();
  answer(said, controller, network.now());
  said.participant.counter += 100;  // the plant has announced in the meantime
  controller.handle(said.stamp, said.participant, "plant1", network.now());
  EXPECT_TRUE(controller.has_plant_finished());
}

TEST_F(ARunningMembership, IsAcknowledgedItsFinishThoughItHasAnnouncedItAgainSince) {
  const auto tell = [&](Membership& from, Membership& to) {
    const auto said = from.announce(network.now());
    to.handle(said.stamp, said.participant, &from == &plant ? "plant1" : "controller3",
              network.now());
  };
  tell(plant, controller);
  EXPECT_FALSE(controller.is_finish_acknowledged()) << "it has not finished";
  controller.on_all_ticks_done();
  plant.on_finished(network.now());
  tell(plant, controller);
  controller.on_finished(network.now());
  EXPECT_FALSE(controller.is_finish_acknowledged()) << "it has not said so";
  tell(controller, plant);
  controller.announce(network.now());  // this announcement is lost
  tell(plant, controller);
  EXPECT_TRUE(controller.is_finish_acknowledged());
}

TEST_F(ARunningMembership, SaysWhyItStopsFromTheFirstReasonOn) {
  using base::ExitCode;
  const auto fault = [&] { return controller.announce(network.now()).participant.fault; };
  EXPECT_EQ(fault(), "");
  controller.on_stopping(base::Failure(ExitCode::interrupted, "first"), network.now());
  controller.on_stopping(base::Failure(ExitCode::peer_lost, "second"), network.now());
  EXPECT_EQ(fault(), "first");
  controller.on_failed(base::Failure(ExitCode::peer_lost, "third"), network.now());
  EXPECT_EQ(fault(), "first");
}

TEST_F(ARunningMembership, SaysHowFarItIs) {
  controller.on_progress(17, 0.25);
  const auto said = controller.announce(network.now());
  EXPECT_EQ(said.stamp.tick, 17);
  EXPECT_EQ(said.stamp.run, plants_run);
  EXPECT_EQ(said.participant.error_norm, 0.25);
  EXPECT_EQ(said.participant.state, ParticipantState::running);
}

TEST(AMembership, GoesOnWaitingWhenAPlantLeavesBeforeItIsMet) {
  Network network;
  auto& plant = network.start(Role::plant, 1);
  network.pass(300ms);
  plant.on_failed(base::Failure(base::ExitCode::interrupted, "interrupted"), network.now());
  auto& controller = network.start(Role::controller, 2);
  network.pass(300ms);
  EXPECT_EQ(text(controller), "");
  EXPECT_FALSE(controller.has_joined());
}

TEST(AMembership, OfAPlantThatYieldsToAnotherIsTakenUpByTheOther) {
  Network network;
  auto& reference = network.start(Role::reference, 2);
  auto& yielding = network.start(Role::plant, 9);
  network.pass(150ms);
  ASSERT_EQ(reference.run(), plants_run);
  network.next_run = plants_run + 1;
  auto& plant = network.start(Role::plant, 1);
  network.pass(500ms);
  EXPECT_EQ(code(yielding), base::ExitCode::protocol_violated);
  network.start(Role::controller, 3);
  network.start(Role::logger, 4);
  network.pass(1s);
  EXPECT_TRUE(plant.is_running());
  EXPECT_TRUE(reference.is_running());
  EXPECT_EQ(reference.run(), plants_run + 1);
  network.pass(6s);
  EXPECT_EQ(text(plant) + text(reference), "");
}

TEST(AMembership, GivesUpAPlantThatFallsSilentBeforeTheRunAndTakesAnother) {
  Network network;
  auto& gone = network.start(Role::plant, 9);
  auto& reference = network.start(Role::reference, 2);
  network.pass(150ms);
  ASSERT_EQ(reference.run(), plants_run);
  network.kill(gone);
  network.pass(1200ms);
  EXPECT_EQ(reference.run(), 0);
  network.next_run = plants_run + 1;
  network.start(Role::plant, 1);
  network.pass(150ms);
  EXPECT_EQ(reference.run(), plants_run + 1);
  EXPECT_EQ(text(reference), "");
}

TEST(AMembership, DoesNotJoinARunThatIsUnderWay) {
  Network network;
  network.start(Role::plant, 1);
  network.start(Role::reference, 2);
  auto& controller = network.start(Role::controller, 3);
  network.start(Role::logger, 4);
  network.pass(1s);
  network.kill(controller);
  network.pass(2s);
  auto& late = network.start(Role::controller, 5);
  network.pass(500ms);
  EXPECT_FALSE(late.has_joined());
}

TEST(AMembership, NeedsOnlyRoleInstanceStateDigestAndRosterOfAPlantWithoutAKey) {
  Network network;
  network.counters_required = false;
  auto& reference = network.start(Role::reference, 2);
  auto& controller = network.start(Role::controller, 3);
  auto& logger = network.start(Role::logger, 4);
  network.pass(300ms);
  messages::Participant plant;  // this plant uses no counters and acknowledges nothing
  plant.role = Role::plant;
  plant.instance = 1;
  plant.scenario_digest = 5;
  const auto tell = [&](ParticipantState state) {
    plant.state = state;
    for (Membership* each : {&reference, &controller, &logger}) {
      each->handle({0, plants_run, -1}, plant, "plant1", network.now());
    }
    network.pass(100ms);
  };
  tell(ParticipantState::waiting);
  plant.roster = {1, 2, 3, 4};
  tell(ParticipantState::ready);
  for (Membership* each : {&reference, &controller, &logger}) {
    EXPECT_TRUE(each->has_joined());
    EXPECT_EQ(each->roster(), plant.roster);
    each->on_all_ticks_done();
  }
  tell(ParticipantState::running);
  tell(ParticipantState::finished);
  EXPECT_TRUE(controller.has_plant_finished());
  EXPECT_EQ(text(reference) + text(controller) + text(logger), "");
}

TEST(AMembership, BelievesNothingOfACountingMemberThatAnswersNothingWithoutAKey) {
  Network network;
  network.counters_required = false;
  auto& plant = network.start(Role::plant, 1);
  network.start(Role::reference, 2);
  network.start(Role::controller, 3);
  auto& logger = network.start(Role::logger, 4);
  network.pass(500ms);
  ASSERT_TRUE(plant.is_running());
  plant.on_all_ticks_done();
  messages::Participant finished = logger.announce(network.now()).participant;
  finished.state = ParticipantState::finished;
  const auto counter = finished.counter;
  for (const std::int64_t forged : {std::int64_t{0}, counter + 1000}) {
    finished.counter = forged;
    finished.heard_counter = {};
    EXPECT_FALSE(plant.handle({0, plants_run, 1}, finished, "logger4", network.now()));
  }
  EXPECT_NE(plant.unfinished().find("logger"), std::string::npos);
  // The announcement is of an earlier run, from a process that has ended.
  finished.role = Role::controller;
  finished.instance = 33;
  finished.state = ParticipantState::waiting;
  EXPECT_FALSE(plant.handle({0, plants_run, 1}, finished, "controller33", network.now()));
  network.pass(500ms);
  EXPECT_EQ(text(plant) + text(logger), "");
}

TEST(AMembership, DoesNotCountItsOwnSuspensionAsSilence) {
  Network network;
  auto& plant = network.start(Role::plant, 1);
  for (const Role role : {Role::reference, Role::controller, Role::logger}) {
    network.start(role, 2 + static_cast<int>(role));
  }
  network.pass(500ms);
  ASSERT_TRUE(plant.is_running());
  // After a suspension of a minute, the process reads the clock before it has received anything.
  const auto awake = network.now() + 60s;
  plant.poll(awake);
  EXPECT_FALSE(plant.failure());
  // A process that is really silent is missed as early as usual.
  for (auto now = awake; now < awake + 6s; now += 100ms) plant.poll(now);
  ASSERT_TRUE(plant.failure());
  EXPECT_EQ(plant.failure()->code(), base::ExitCode::peer_lost);
}

TEST(AMembership, AnswersNewcomersAtMostOnceInTenMilliseconds) {
  Network network;
  auto& plant = network.start(Role::plant, 1);
  plant.announce(network.now());
  Membership::Announcement outsider;
  outsider.participant.role = Role::logger;
  outsider.participant.scenario_digest = 5;
  for (int i = 0; i < 1000; ++i) {
    outsider.participant.instance = 1000 + i;
    plant.handle(outsider.stamp, outsider.participant, "flood", network.now());
  }
  EXPECT_EQ(plant.next_announcement(), network.now() + 10ms);
}

TEST(AMembership, RemembersABoundedNumberOfProcesses) {
  Network network;
  auto& plant = network.start(Role::plant, 1);
  network.start(Role::reference, 2);
  network.start(Role::controller, 3);
  Membership::Announcement outsider;
  outsider.participant.role = Role::logger;
  outsider.participant.scenario_digest = 5;
  for (int i = 0; i < 100'000; ++i) {
    outsider.participant.instance = 1000 + i;
    plant.handle(outsider.stamp, outsider.participant, "flood", network.now());
  }
  network.pass(1200ms);
  network.start(Role::logger, 4);
  network.pass(500ms);
  EXPECT_TRUE(plant.is_running());
}

TEST(AMembership, ThatHasChosenItsRosterDoesNotYieldToAnOlderPlantWithout) {
  Network network;
  network.start(Role::reference, 2);
  network.start(Role::controller, 3);
  network.start(Role::logger, 4);
  network.pass(100ms);
  auto& plant = network.start(Role::plant, 1);
  while (plant.roster()[0] == 0 && network.elapsed() < 1s) network.pass(5ms);
  ASSERT_NE(plant.roster()[0], 0);
  ASSERT_FALSE(plant.has_joined());
  auto said = plant.announce(network.now());
  said.stamp.utime = 1'000'000'000;
  said.participant.instance = 9;
  said.participant.state = ParticipantState::waiting;
  said.participant.roster = {};
  answer(said, plant, network.now());
  plant.handle(said.stamp, said.participant, "plant9", network.now());
  EXPECT_EQ(text(plant), "");
}

TEST(AMembership, KeepsToThePlantItAdoptedWhenAnotherBeginsWithOthers) {
  Network network;
  auto& plant = network.start(Role::plant, 1);
  auto& controller = network.start(Role::controller, 3);
  network.pass(300ms);
  ASSERT_EQ(controller.run(), plants_run);
  auto said = plant.announce(network.now());
  said.stamp.run = plants_run + 1;
  said.participant.instance = 9;
  said.participant.state = ParticipantState::ready;
  said.participant.roster = {9, 12, 13, 14};
  answer(said, controller, network.now());
  controller.handle(said.stamp, said.participant, "plant9", network.now());
  EXPECT_EQ(text(controller), "");
  EXPECT_EQ(controller.run(), plants_run);
}

TEST(AMembership, NeedsARunFromThePlantAndFromNobodyElse) {
  Membership::Self self;
  self.who.role = Role::plant;
  EXPECT_THROW(Membership(self, {}), std::logic_error);
  self.who.role = Role::logger;
  self.run = 3;
  EXPECT_THROW(Membership(self, {}), std::logic_error);
}

}  // namespace
}  // namespace tachless::session
