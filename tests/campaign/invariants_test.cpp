// Each invariant must reject a round that violates it, and no other round.
#include "tests/campaign/invariants.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "messages/wire.h"

namespace tachless::campaign {
namespace {

using base::ExitCode;
using messages::Role;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

const std::string reason = "interrupted";

Event fault_event() {
  messages::Codec<messages::Participant> codec(messages::Layout{});
  messages::Participant who;
  who.state = messages::ParticipantState::fault;
  who.fault = reason;
  const auto bytes = codec.encode({0, 7, 1}, who);
  return {"ARM_PARTICIPANT", 1, {reinterpret_cast<const char*>(bytes.data()), bytes.size()}};
}

/// Returns two ticks in lockstep that ended well.
Evidence good() {
  Evidence evidence;
  evidence.num_ticks = 2;
  evidence.period_s = 1;
  evidence.give_up_s = 3;
  evidence.log.push_back({"ARM_RUN_INFO", -1, "info"});
  for (std::int64_t k = 0; k < 2; ++k) {
    for (const auto* channel : {"ARM_TICK", "ARM_POSITION", "ARM_REFERENCE", "ARM_COMMAND",
                                "ARM_CONTROLLER_STATE", "ARM_TRUTH"}) {
      evidence.log.push_back({channel, k, "said"});
    }
  }
  evidence.clean_log = evidence.log;
  for (const Role role : system_test::all_roles) evidence.result.of[role].code = ExitCode::done;
  return evidence;
}

/// Returns the same round without a key and with an outsider, in which all processes fail after the
/// first tick.
Evidence failed() {
  Evidence evidence = good();
  evidence.plan.hostility = Hostility();
  evidence.plan.hostility->forges = true;
  evidence.log.resize(7);
  evidence.log.push_back(fault_event());
  for (auto& [role, outcome] : evidence.result.of) {
    outcome.code = ExitCode::protocol_violated;
    outcome.fault = reason;
  }
  return evidence;
}

TEST(Invariants, HoldOfAGoodRunAndOfOneThatFailsAsItShould) {
  EXPECT_THAT(violations(good()), IsEmpty());
  EXPECT_THAT(violations(failed()), IsEmpty());
}

TEST(Invariants, SayThatSomebodyEndsWellWithoutAWholeLog) {
  Evidence evidence = failed();
  evidence.result.of[Role::plant].code = ExitCode::done;
  EXPECT_THAT(violations(evidence),
              ElementsAre("the plant ends with 0: the log has 7 of 13 events"));
  evidence.plan.pace = Pace::realtime;
  EXPECT_THAT(a_good_end_has_a_whole_log(evidence), HasSubstr("lacks ARM_TICK of 1"));
  // The logger was suspended and missed messages that are not repeated.
  evidence.num_overflowed = 3;
  EXPECT_EQ(a_good_end_has_a_whole_log(evidence), "");
}

TEST(Invariants, LetAPlantEndWellThatAnOutsiderWasTheLoggerTo) {
  Evidence evidence = failed();
  evidence.result.of[Role::plant].code = ExitCode::done;
  evidence.plan.hostility.emplace();
  evidence.plan.hostility->acknowledges = true;
  EXPECT_THAT(a_good_end_has_a_whole_log(evidence), HasSubstr("the plant ends with 0"));
  evidence.plan.hostility->contradicts = true;
  EXPECT_EQ(a_good_end_has_a_whole_log(evidence), "");
  evidence.plan.keyed = true;
  EXPECT_THAT(a_good_end_has_a_whole_log(evidence), HasSubstr("the plant ends with 0"));
  evidence.plan.keyed = false;
  evidence.result.of[Role::logger].code = ExitCode::done;
  EXPECT_THAT(a_good_end_has_a_whole_log(evidence), HasSubstr("the plant ends with 0"));
}

TEST(Invariants, SayThatTheLogIsNotTheCleanOneUnlessAStrangerHasLiedWithoutAKey) {
  Evidence evidence = good();
  evidence.log[10].data = "other";
  const std::string complaint = "ARM_COMMAND of tick 1 is not the clean run's";
  EXPECT_EQ(the_log_is_a_beginning_of_the_clean_one(evidence), complaint);
  EXPECT_EQ(a_good_end_has_a_whole_log(evidence), "the plant ends with 0: " + complaint);
  evidence.lies = {1};
  EXPECT_THAT(violations(evidence), IsEmpty());
  evidence.plan.keyed = true;
  EXPECT_EQ(the_log_is_a_beginning_of_the_clean_one(evidence), complaint);
}

TEST(Invariants, SayThatALogHasPartOfATickOrDamage) {
  Evidence evidence = failed();
  evidence.log.erase(evidence.log.begin() + 6);
  EXPECT_THAT(violations(evidence), ElementsAre("the log's 6 events are not whole ticks"));
  evidence.log_damaged = true;
  EXPECT_THAT(violations(evidence), ElementsAre("the log is damaged"));
}

TEST(Invariants, SayThatARunWithAKeyDidNotEndWell) {
  Evidence evidence = failed();
  evidence.plan.keyed = true;
  EXPECT_THAT(violations(evidence), ElementsAre(HasSubstr("nothing could end this run")));
  evidence.plan.mishap.emplace().kind = Mishap::Kind::interrupt;
  EXPECT_THAT(violations(evidence), ElementsAre(HasSubstr("nothing could end this run")));
  evidence.mishap_happened = true;
  EXPECT_THAT(violations(evidence), IsEmpty());
}

TEST(Invariants, SayThatAFaultHasNoCodeOrNoCauseOrTwo) {
  Evidence evidence = failed();
  evidence.result.of[Role::reference].code = static_cast<ExitCode>(77);
  EXPECT_THAT(violations(evidence), ElementsAre("the reference ends with 77"));
  evidence = failed();
  evidence.result.of[Role::logger].fault = "";
  EXPECT_THAT(violations(evidence), ElementsAre("the logger does not say why it ends"));
  evidence = failed();
  evidence.result.of[Role::logger].fault = "the disk is full\nthe plant is lost";
  EXPECT_THAT(violations(evidence), ElementsAre(HasSubstr("the logger tells more than one cause")));
  evidence = failed();
  const std::string sentence =
      "no answer from the controller (process 4123 on host arm-1, 10.0.0.2:4123)"
      ", silent for 3 s; see its output (loop.give_up_s)";
  evidence.result.of[Role::plant].fault = sentence + ": " + sentence;
  EXPECT_THAT(violations(evidence), ElementsAre(HasSubstr("the plant says twice 'no answer from")));
}

TEST(Invariants, SayThatTheLogDoesNotEndWithTheFaultThoughTheLoggerLives) {
  Evidence evidence = failed();
  evidence.log.pop_back();
  EXPECT_THAT(violations(evidence),
              ElementsAre("the log of a run that failed ends with ARM_TRUTH"));
  evidence.plan.mishap.emplace().role = Role::logger;
  evidence.mishap_happened = true;
  EXPECT_THAT(violations(evidence), IsEmpty());
}

TEST(Invariants, SayThatAnOutsiderFillsTheDiskOrNamesSomethingInTheLog) {
  Evidence evidence = good();
  evidence.clean_log_bytes = 1000;
  evidence.log_bytes = 1000 + most_foreign_log_bytes;
  EXPECT_THAT(violations(evidence), IsEmpty());
  ++evidence.log_bytes;
  EXPECT_THAT(violations(evidence), ElementsAre("the log has 1049577 bytes, the clean one 1000"));
  evidence = failed();
  // No codec encodes such a name, so an escape replaces a space of the encoded name.
  messages::Codec<messages::Participant> codec(messages::Layout{});
  messages::Participant who;
  who.law = "a law";
  const auto bytes = codec.encode({0, 7, 1}, who);
  std::string data(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  evidence.log.insert(evidence.log.end() - 1, {"ARM_PARTICIPANT", 1, data});
  EXPECT_EQ(the_log_has_sound_names(evidence), "");
  data[data.find("a law") + 1] = '\x1b';
  evidence.log[evidence.log.size() - 2].data = data;
  EXPECT_THAT(the_log_has_sound_names(evidence), HasSubstr("control characters"));
}

TEST(Invariants, SayThatTheRobotMovesUnrecordedOrThatARoundTakesTooLong) {
  Evidence evidence = failed();
  evidence.plan.pace = Pace::realtime;
  evidence.result.of[Role::plant].statistics.ticks = 1 + 3;
  EXPECT_THAT(violations(evidence), IsEmpty());
  evidence.result.of[Role::plant].statistics.ticks = 1 + 4;
  EXPECT_THAT(violations(evidence), ElementsAre("the robot moves for 4 s after the log's end"));
  evidence = good();
  evidence.wall_s = 40;
  EXPECT_THAT(violations(evidence), ElementsAre("it takes 40 s"));
  evidence.wall_s = 1;
  evidence.hung = true;
  EXPECT_THAT(violations(evidence), ElementsAre("it takes 1 s, interrupted"));
}

}  // namespace
}  // namespace tachless::campaign
