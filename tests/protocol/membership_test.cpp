#include "protocol/membership.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <random>
#include <string>
#include <vector>

namespace tachless::protocol {
namespace {

using namespace std::chrono_literals;
using loop::ParticipantState;
using loop::Role;
using testing::HasSubstr;

constexpr std::int64_t plants_run = 77;

/// Processes that hear each other over a network that may lose announcements, in virtual time.
class Meeting {
 public:
  struct Process {
    Role role;
    std::string name;
    std::unique_ptr<Membership> rendezvous;
    bool dead = false;  ///< gone, with or without a word
  };

  explicit Meeting(double loss = 0, std::uint64_t seed = 1) : loss_(loss), random_(seed) {}

  /// Starts a process now.
  Membership& start(Role role, std::int64_t instance, std::int64_t digest = 5,
                    std::optional<std::chrono::nanoseconds> wait_limit = {}) {
    Membership::Self self;
    self.role = role;
    self.instance = instance;
    self.digest = digest;
    self.pid = static_cast<std::int32_t>(instance);
    self.host = "arm-1";
    self.scenario = "scenario_" + std::to_string(digest);
    self.measurement = role == Role::controller ? "POSITION" : "";
    self.run = role == Role::plant ? plants_run : 0;
    self.wait_limit = wait_limit;
    self.succession = succession;
    self.resumes = resumes;
    processes_.push_back({role, std::string(loop::name(role)) + std::to_string(instance),
                          std::make_unique<Membership>(self, now_)});
    return *processes_.back().rendezvous;
  }

  bool succession = true;  ///< of the processes started from now on
  bool resumes = false;

  void kill(const Membership& victim) { of(victim).dead = true; }

  /// Lets time pass. A process that has failed says so some times and is gone.
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
        processes_, [&](const Process& each) { return each.rendezvous.get() == &which; });
  }

  void step(Process& process) {
    if (process.dead) return;
    Membership& mine = *process.rendezvous;
    mine.check(now_);
    if (mine.failure()) {
      for (int i = 0; i < 5; ++i) broadcast(process);
      process.dead = true;
      return;
    }
    if (process.role == Role::plant && mine.met()) mine.started(now_);
    if (now_ >= mine.next_announcement()) broadcast(process);
  }

  void broadcast(Process& from) {
    const auto said = from.rendezvous->announce(now_);
    for (Process& to : processes_) {
      if (&to == &from || to.dead) continue;
      if (std::uniform_real_distribution<double>()(random_) < loss_) continue;
      to.rendezvous->hear(said.stamp, said.participant, from.name, now_);
      const bool plant_runs = said.participant.role == Role::plant &&
                              said.participant.state == ParticipantState::running;
      if (plant_runs && to.rendezvous->met() && !to.rendezvous->failure() &&
          to.rendezvous->run() == said.stamp.run) {
        to.rendezvous->started(now_);  // as the first question would make it
      }
    }
  }

  double loss_;
  std::mt19937_64 random_;
  Membership::Time now_{};
  std::vector<Process> processes_;
};

diagnostics::ExitCode code(const Membership& process) {
  return process.failure() ? process.failure()->code() : diagnostics::ExitCode::done;
}
std::string text(const Membership& process) {
  return process.failure() ? process.failure()->what() : "";
}

TEST(ARendezvous, MeetsInEveryOrderOfStarting) {
  std::vector<Role> order = {Role::plant, Role::reference, Role::controller, Role::logger};
  do {
    Meeting meeting;
    std::vector<const Membership*> all;
    for (const Role role : order) {
      EXPECT_EQ(std::ranges::count_if(all, [](auto* each) { return each->running(); }), 0);
      all.push_back(&meeting.start(role, static_cast<std::int64_t>(all.size()) + 1));
      meeting.pass(700ms);
    }
    for (const auto* each : all) {
      EXPECT_TRUE(each->running());
      EXPECT_EQ(each->run(), plants_run);
      EXPECT_EQ(text(*each), "");
    }
  } while (std::ranges::next_permutation(order).found);
}

TEST(ARendezvous, IsQuickWhenAllAreThere) {
  Meeting meeting;
  auto& plant = meeting.start(Role::plant, 1);
  auto& reference = meeting.start(Role::reference, 2);
  auto& controller = meeting.start(Role::controller, 3);
  auto& logger = meeting.start(Role::logger, 4);
  meeting.pass(50ms);
  EXPECT_TRUE(plant.running());
  EXPECT_TRUE(reference.met() && controller.met() && logger.met());
  EXPECT_EQ(plant.measurement(), "POSITION");
  EXPECT_EQ(logger.measurement(), "POSITION");
}

TEST(ARendezvous, SucceedsUnderLoss) {
  for (std::uint64_t seed = 0; seed < 200; ++seed) {
    Meeting meeting(0.3, seed);
    auto& plant = meeting.start(Role::plant, 1);
    meeting.start(Role::reference, 2);
    meeting.start(Role::controller, 3);
    meeting.start(Role::logger, 4);
    meeting.pass(5s);
    EXPECT_TRUE(plant.running()) << seed;
    meeting.pass(20s);
    EXPECT_EQ(text(plant), "") << seed;
  }
}

TEST(ARendezvous, TellsWhoIsMissing) {
  Meeting meeting;
  auto& plant = meeting.start(Role::plant, 1);
  meeting.start(Role::logger, 2);
  meeting.pass(1s);
  EXPECT_THAT(plant.missing(), testing::ElementsAre(Role::reference, Role::controller));
  meeting.pass(1h);
  EXPECT_EQ(text(plant), "");
}

TEST(ARendezvous, WaitsNoLongerThanAllowed) {
  Meeting meeting;
  auto& plant = meeting.start(Role::plant, 1, 5, 2s);
  meeting.start(Role::logger, 2);
  meeting.pass(1900ms);
  EXPECT_EQ(code(plant), diagnostics::ExitCode::done);
  meeting.pass(200ms);
  EXPECT_EQ(code(plant), diagnostics::ExitCode::peer_lost);
  EXPECT_THAT(text(plant), HasSubstr("waited 2 s for reference, controller"));
}

TEST(ARendezvous, OfDifferentScenariosIsRefusedByBothSides) {
  for (const double loss : {0.0, 0.3}) {
    Meeting meeting(loss);
    auto& plant = meeting.start(Role::plant, 1, 5);
    auto& controller = meeting.start(Role::controller, 2, 6);
    meeting.pass(1s);
    EXPECT_EQ(code(plant), diagnostics::ExitCode::bad_usage);
    EXPECT_EQ(code(controller), diagnostics::ExitCode::bad_usage);
    EXPECT_THAT(text(plant),
                HasSubstr("the controller (process 2 on arm-1, controller2) runs scenario "
                          "'scenario_6' (digest 0000000000000006), this plant runs scenario "
                          "'scenario_5' (digest 0000000000000005)"));
    EXPECT_THAT(text(controller), HasSubstr("this controller runs scenario 'scenario_6'"));
  }
}

TEST(ARendezvous, ThatIsOverIgnoresANewcomerWithAnotherScenario) {
  Meeting meeting;
  auto& plant = meeting.start(Role::plant, 1);
  meeting.start(Role::reference, 2);
  auto& controller = meeting.start(Role::controller, 3);
  meeting.start(Role::logger, 4);
  meeting.pass(1s);
  ASSERT_TRUE(plant.running());
  auto& stranger = meeting.start(Role::logger, 5, 6);
  meeting.pass(3s);
  EXPECT_NE(code(stranger), diagnostics::ExitCode::done);
  EXPECT_EQ(text(plant), "");
  EXPECT_EQ(text(controller), "");
}

TEST(ARendezvous, RefusesASecondHolderOfARoleAndLeavesTheFirstAlone) {
  for (const std::int64_t instance : {1, 9}) {  // smaller and larger than the first's
    for (const bool all_there : {false, true}) {
      Meeting meeting;
      auto& first = meeting.start(Role::controller, 5);
      std::vector<Membership*> others = {&first};
      if (all_there) {
        others.push_back(&meeting.start(Role::plant, 2));
        others.push_back(&meeting.start(Role::reference, 3));
        others.push_back(&meeting.start(Role::logger, 4));
      }
      meeting.pass(2s);
      auto& second = meeting.start(Role::controller, instance);
      meeting.pass(2s);
      EXPECT_EQ(code(second), diagnostics::ExitCode::protocol_violated);
      EXPECT_THAT(text(second),
                  HasSubstr("there is already the controller (process 5 on arm-1, controller5)"));
      for (const auto* each : others) EXPECT_EQ(text(*each), "");
      EXPECT_EQ(first.running(), all_there);
    }
  }
}

TEST(ARendezvous, LeavesExactlyOneOfSeveralThatStartTogether) {
  for (std::uint64_t seed = 0; seed < 300; ++seed) {
    std::mt19937_64 random(seed);
    Meeting meeting(seed % 2 == 0 ? 0 : 0.3, seed);
    auto& plant = meeting.start(Role::plant, 50);
    meeting.start(Role::reference, 51);
    meeting.start(Role::logger, 52);
    std::vector<Membership*> controllers;
    for (int i = 0; i < 3; ++i) {
      controllers.push_back(&meeting.start(
          Role::controller, static_cast<std::int64_t>(random() % 1000) * 10 + i + 100));
      meeting.pass(std::chrono::milliseconds(random() % 500));
    }
    meeting.pass(4s);
    int left = 0;
    for (const auto* each : controllers) {
      left += each->failure() ? 0 : 1;
      if (!each->failure()) continue;
      EXPECT_EQ(code(*each), diagnostics::ExitCode::protocol_violated);
    }
    EXPECT_EQ(left, 1) << seed;
    EXPECT_TRUE(plant.running()) << seed;
    EXPECT_EQ(text(plant), "") << seed;
  }
}

class ARunningRendezvous : public testing::Test {
 protected:
  void SetUp() override {
    meeting.pass(1s);
    ASSERT_TRUE(plant.running());
  }
  Meeting meeting;
  Membership& plant = meeting.start(Role::plant, 1);
  Membership& reference = meeting.start(Role::reference, 2);
  Membership& controller = meeting.start(Role::controller, 3);
  Membership& logger = meeting.start(Role::logger, 4);
};

TEST_F(ARunningRendezvous, EndsForAllWhenOneIsInterrupted) {
  controller.failed(diagnostics::Failure(diagnostics::ExitCode::interrupted, "interrupted"),
                    meeting.now());
  meeting.pass(200ms);
  for (const auto* each : {&plant, &reference, &logger}) {
    EXPECT_EQ(code(*each), diagnostics::ExitCode::peer_lost);
    EXPECT_THAT(text(*each), HasSubstr("interrupted"));
  }
  EXPECT_THAT(text(plant), HasSubstr("ended because of the controller (process 3"));
}

TEST_F(ARunningRendezvous, PassesOnTheExitCodeOfAFault) {
  for (const diagnostics::ExitCode fault : {diagnostics::ExitCode::protective_stop}) {
    plant.failed(diagnostics::Failure(fault, "joint 1 ran away"), meeting.now());
    meeting.pass(200ms);
    for (const auto* each : {&controller, &reference, &logger}) {
      EXPECT_EQ(code(*each), fault);
      EXPECT_THAT(text(*each), HasSubstr("joint 1 ran away"));
    }
  }
}

TEST_F(ARunningRendezvous, NoticesAPeerThatDiesWithoutAWord) {
  meeting.kill(reference);
  meeting.pass(4900ms);
  EXPECT_EQ(text(plant), "");
  meeting.pass(300ms);
  EXPECT_EQ(code(plant), diagnostics::ExitCode::peer_lost);
  EXPECT_THAT(text(plant), HasSubstr("the reference (process 2 on arm-1, reference2) has been "
                                     "silent for 5 s"));
  EXPECT_EQ(code(logger), diagnostics::ExitCode::peer_lost);
}

TEST_F(ARunningRendezvous, NoticesAPlantThatDiesWithoutAWord) {
  meeting.kill(plant);
  meeting.pass(5200ms);
  for (const auto* each : {&controller, &reference, &logger}) {
    EXPECT_EQ(code(*each), diagnostics::ExitCode::peer_lost);
    EXPECT_THAT(text(*each), HasSubstr("the plant"));
  }
}

TEST_F(ARunningRendezvous, IgnoresFaultsOfStrangers) {
  Meeting elsewhere;
  auto& other = elsewhere.start(Role::controller, 90);
  other.failed(diagnostics::Failure(diagnostics::ExitCode::interrupted, "interrupted"),
               meeting.now());
  auto said = other.announce(meeting.now());
  said.stamp.run = 1234;
  plant.hear(said.stamp, said.participant, "somebody", meeting.now());
  said.stamp.run = plants_run;  // in our run, but not the controller we started with
  plant.hear(said.stamp, said.participant, "somebody", meeting.now());
  EXPECT_EQ(text(plant), "");
}

TEST_F(ARunningRendezvous, GivesWayToNobodyOutsideItsRun) {
  auto said = plant.announce(meeting.now());
  said.stamp.run = plants_run + 1;
  said.stamp.utime = 1'000'000'000;  // older than all of ours
  said.participant.instance = 0x5eed;
  said.participant.state = loop::ParticipantState::running;
  plant.hear(said.stamp, said.participant, "somebody", meeting.now());
  EXPECT_EQ(text(plant), "");
}

TEST_F(ARunningRendezvous, PartsWhenAllHaveFinished) {
  plant.finished(meeting.now());
  EXPECT_FALSE(plant.all_finished());
  meeting.pass(200ms);
  EXPECT_TRUE(controller.plant_finished() && reference.plant_finished() && logger.plant_finished());
  controller.finished(meeting.now());
  reference.finished(meeting.now());
  meeting.pass(200ms);
  EXPECT_FALSE(plant.all_finished());
  logger.finished(meeting.now());
  meeting.pass(200ms);
  EXPECT_TRUE(plant.all_finished());
}

TEST_F(ARunningRendezvous, SaysHowFarItIs) {
  controller.progressed(17, 0.25);
  const auto said = controller.announce(meeting.now());
  EXPECT_EQ(said.stamp.tick, 17);
  EXPECT_EQ(said.stamp.run, plants_run);
  EXPECT_EQ(said.participant.error_norm, 0.25);
  EXPECT_EQ(said.participant.state, ParticipantState::running);
}

TEST(ARendezvous, GoesOnWaitingWhenAPlantLeavesBeforeItIsMet) {
  Meeting meeting;
  auto& plant = meeting.start(Role::plant, 1);
  meeting.pass(300ms);
  plant.failed(diagnostics::Failure(diagnostics::ExitCode::interrupted, "interrupted"),
               meeting.now());
  auto& controller = meeting.start(Role::controller, 2);
  meeting.pass(300ms);
  EXPECT_EQ(text(controller), "");
  EXPECT_FALSE(controller.met());
}

TEST(ARendezvous, DoesNotJoinARunThatIsUnderWay) {
  Meeting meeting;
  meeting.start(Role::plant, 1);
  meeting.start(Role::reference, 2);
  auto& controller = meeting.start(Role::controller, 3);
  meeting.start(Role::logger, 4);
  meeting.pass(1s);
  meeting.kill(controller);
  meeting.pass(2s);
  auto& late = meeting.start(Role::controller, 5);
  meeting.pass(500ms);
  EXPECT_FALSE(late.met());
}

/// A run under way, and a controller that wants to resume it.
class ASuccession : public testing::Test {
 protected:
  explicit ASuccession(bool succession = true) {
    meeting.succession = succession;
    plant = &meeting.start(Role::plant, 1);
    reference = &meeting.start(Role::reference, 2);
    controller = &meeting.start(Role::controller, 3);
    logger = &meeting.start(Role::logger, 4);
    meeting.pass(500ms);
    for (Membership* each : {reference, controller, logger}) each->started(meeting.now());
    meeting.pass(300ms);
    controller->progressed(40, 0);
    meeting.pass(200ms);
  }
  Membership& successor(std::int64_t instance = 5, std::int64_t digest = 5) {
    meeting.resumes = true;
    return meeting.start(Role::controller, instance, digest);
  }

  Meeting meeting;
  Membership* plant;
  Membership* reference;
  Membership* controller;
  Membership* logger;
};

TEST_F(ASuccession, BeginsWhenTheControllerHasBeenSilentForHalfASecond) {
  EXPECT_EQ(plant->tick_of(Role::controller), 40);
  meeting.kill(*controller);
  auto& next = successor();
  meeting.pass(300ms);
  EXPECT_TRUE(next.met()) << "with the plant, which runs already";
  EXPECT_EQ(next.run(), plants_run);
  EXPECT_EQ(plant->successions(), 0);
  next.progressed(17, 0);
  meeting.pass(400ms);
  for (const Membership* each : {plant, reference, logger}) {
    EXPECT_EQ(each->successions(), 1);
    EXPECT_EQ(each->tick_of(Role::controller), 17);
    EXPECT_FALSE(each->failure());
  }
  next.started(meeting.now());
  meeting.pass(7s);
  EXPECT_FALSE(plant->failure()) << "the old one is missed by nobody";
  next.finished(meeting.now());
  meeting.pass(200ms);
  EXPECT_FALSE(plant->failure());
}

TEST_F(ASuccession, IsRefusedWhileTheControllerSpeaks) {
  auto& next = successor();
  meeting.pass(1s);
  ASSERT_TRUE(next.failure());
  EXPECT_EQ(next.failure()->code(), diagnostics::ExitCode::protocol_violated);
  EXPECT_THAT(next.failure()->what(), HasSubstr("there is already the controller (process 3"));
  EXPECT_EQ(plant->successions(), 0);
  EXPECT_FALSE(plant->failure());
  EXPECT_FALSE(controller->failure());
}

TEST_F(ASuccession, OfOneThatCannotResumeEndsTheRunOnceTheOldOneIsGone) {
  meeting.kill(*controller);
  auto& next = successor();
  meeting.pass(300ms);
  // Said at once, when the old one may still be there, and not again.
  next.failed(diagnostics::Failure(diagnostics::ExitCode::bad_usage, "the log ends too early"),
              meeting.now());
  meeting.pass(100ms);
  EXPECT_FALSE(plant->failure());
  meeting.pass(300ms);
  for (const Membership* each : {plant, reference, logger}) {
    ASSERT_TRUE(each->failure());
    EXPECT_EQ(each->failure()->code(), diagnostics::ExitCode::peer_lost);
    EXPECT_THAT(each->failure()->what(), HasSubstr("the log ends too early"));
  }
}

TEST_F(ASuccession, OfOneThatCannotResumeIsForgottenWhenTheOldOneSpeaks) {
  loop::Participant failed;
  failed.role = Role::controller;
  failed.instance = 5;
  failed.scenario_digest = 5;
  failed.state = loop::ParticipantState::fault;
  failed.fault_code = static_cast<int>(diagnostics::ExitCode::bad_usage);
  failed.fault = "the log ends too early";
  plant->hear({0, plants_run, -1}, failed, "controller5", meeting.now());
  meeting.pass(300ms);
  meeting.kill(*controller);
  meeting.pass(2s);
  EXPECT_FALSE(plant->failure()) << "it waits for another";
}

TEST_F(ASuccession, IsNotForAnotherScenario) {
  meeting.kill(*controller);
  auto& next = successor(5, 6);
  meeting.pass(2s);
  EXPECT_TRUE(next.failure());
  EXPECT_EQ(plant->successions(), 0);
}

TEST_F(ASuccession, IsNotForOneThatStartsAnew) {
  meeting.kill(*controller);
  auto& fresh = meeting.start(Role::controller, 5);
  meeting.pass(2s);
  EXPECT_FALSE(fresh.met());
  EXPECT_EQ(plant->successions(), 0);
}

TEST_F(ASuccession, CanBeRepeated) {
  meeting.kill(*controller);
  auto& second = successor(5);
  meeting.pass(1s);
  second.started(meeting.now());
  meeting.kill(second);
  successor(6);
  meeting.pass(1s);
  EXPECT_EQ(plant->successions(), 2);
  EXPECT_FALSE(plant->failure());
}

class NoSuccession : public ASuccession {
 protected:
  NoSuccession() : ASuccession(false) {}
};

TEST_F(NoSuccession, HappensInRealtime) {
  meeting.kill(*controller);
  successor();
  meeting.pass(2s);
  EXPECT_EQ(plant->successions(), 0);
  meeting.pass(5s);
  ASSERT_TRUE(plant->failure());
  EXPECT_EQ(plant->failure()->code(), diagnostics::ExitCode::peer_lost);
}

TEST(ARendezvous, TakesItsOwnSleepForNobodysSilence) {
  Meeting meeting;
  auto& plant = meeting.start(Role::plant, 1);
  for (const Role role : {Role::reference, Role::controller, Role::logger}) {
    meeting.start(role, 2 + static_cast<int>(role));
  }
  meeting.pass(500ms);
  ASSERT_TRUE(plant.running());
  // Kept from running for a minute, it looks at the clock before it has heard anything.
  const auto awake = meeting.now() + 60s;
  plant.check(awake);
  EXPECT_FALSE(plant.failure());
  // Who is really silent is missed as soon as ever.
  for (auto now = awake; now < awake + 6s; now += 100ms) plant.check(now);
  ASSERT_TRUE(plant.failure());
  EXPECT_EQ(plant.failure()->code(), diagnostics::ExitCode::peer_lost);
}

TEST(ARendezvous, RemembersABoundedNumberOfStrangers) {
  Meeting meeting;
  auto& plant = meeting.start(Role::plant, 1);
  meeting.start(Role::reference, 2);
  meeting.start(Role::controller, 3);
  Membership::Announcement stranger;
  stranger.participant.role = Role::logger;
  stranger.participant.scenario_digest = 5;
  for (int i = 0; i < 100'000; ++i) {
    stranger.participant.instance = 1000 + i;
    plant.hear(stranger.stamp, stranger.participant, "flood", meeting.now());
  }
  meeting.pass(1200ms);
  meeting.start(Role::logger, 4);
  meeting.pass(500ms);
  EXPECT_TRUE(plant.running());
}

TEST(ARendezvous, NeedsARunFromThePlantAndFromNobodyElse) {
  Membership::Self self;
  self.role = Role::plant;
  EXPECT_THROW(Membership(self, {}), std::logic_error);
  self.role = Role::logger;
  self.run = 3;
  EXPECT_THROW(Membership(self, {}), std::logic_error);
}

}  // namespace
}  // namespace tachless::protocol
