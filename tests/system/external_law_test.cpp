// These tests run laws of programs that are not part of tachless. tachless-own-law (own_law.cpp)
// has the law of paper_rigid under another name, so its torques are known to the last bit.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <future>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

#include "base/failure.h"
#include "base/json_text.h"
#include "controller/law_socket.h"
#include "logger/run_log.h"
#include "reference/make_trajectory.h"
#include "robot/dynamics.h"
#include "tests/support/private_network.h"
#include "tests/support/process_facts.h"
#include "tests/support/program.h"
#include "tests/system/four_programs.h"

namespace tachless::external_law_test {
namespace {

namespace fs = std::filesystem;
using controller::Gravity;
using system_test::scenarios;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

using Words = std::vector<std::string>;

class ExternalLaw : public ::testing::Test {
 protected:
  struct Recorded {
    int code;
    std::string output, errors;
  };

  ~ExternalLaw() override { unsetenv("OWN_LAW"); }

  Program start(const Words& words) { return {"tachless", words, directory_.path()}; }
  int tachless(const Words& words) {
    Program program = start(words);
    const int code = program.wait();
    errors_ = program.errors();
    output_ = program.output();
    return code;
  }
  /// Returns the words that run paper_rigid for 0.1 s into `out`.
  Words run(const std::string& out, const Words& more = {}) {
    Words words = {"run",        scenarios + "paper_rigid.yaml",
                   "--duration", "0.1",
                   "--run-id",   "7",
                   "--out",      (directory_ / out)};
    words.insert(words.end(), more.begin(), more.end());
    return words;
  }
  Words with_program(Words words) const {
    words.insert(words.end(), {"--controller", program()});
    return words;
  }
  [[nodiscard]] static std::string program() { return TACHLESS_BINARY_DIR "/bin/tachless-own-law"; }
  [[nodiscard]] std::string log(const std::string& out) const {
    return directory_ / (out + "/lcmlog");
  }
  std::vector<Vector> torques(const std::string& out) {
    std::vector<Vector> all;
    logger::RunLog recorded = logger::RunLog::open(log(out));
    logger::TickRecord record;
    while (recorded.next(record)) all.push_back(record.command.value().tau);
    return all;
  }
  /// Copies the run of the program's law under the name `own`. The first test that asks runs it.
  void record() {
    static const TemporaryDirectory kept;
    static const Recorded recorded = [&] {
      const int code = tachless(with_program(run("own")));
      if (code == 0) fs::copy(directory_ / "own", kept / "own", fs::copy_options::recursive);
      return Recorded{code, output_, errors_};
    }();
    output_ = recorded.output;
    errors_ = recorded.errors;
    ASSERT_EQ(recorded.code, 0) << errors_;
    if (!fs::exists(directory_ / "own")) {
      fs::copy(kept / "own", directory_ / "own", fs::copy_options::recursive);
    }
  }
  int replay_misbehaving(const char* how) {
    setenv("OWN_LAW", how, 1);
    return tachless(with_program({"replay", log("own")}));
  }

  TemporaryDirectory directory_;
  std::string errors_, output_;
};

TEST_F(ExternalLaw, CommandsWhatItWouldInsideAndIsCalledByItsName) {
  ASSERT_EQ(tachless(run("inside")), 0) << errors_;
  record();
  EXPECT_THAT(output_, HasSubstr("\npaper_rigid: own_law (external), h = 50 µs\n"));
  const auto inside = torques("inside"), own = torques("own");
  ASSERT_EQ(own.size(), 2000U);
  EXPECT_TRUE(inside == own);
  const auto summary = base::parse_json(contents(directory_ / "own/summary.json"));
  EXPECT_EQ(summary["law"], "own_law (external)");
  const std::string report = contents(directory_ / "own/report.html");
  EXPECT_THAT(report, AllOf(HasSubstr("own_law (external)"), HasSubstr("no function is evaluated"),
                            Not(HasSubstr("loria_ortega"))));
}

TEST_F(ExternalLaw, LeavesTheSameLogInOneProcess) {
  record();
  ASSERT_EQ(tachless(with_program(run("alone", {"--in-process"}))), 0) << errors_;
  EXPECT_TRUE(contents(log("own")) == contents(log("alone")));
}

TEST_F(ExternalLaw, IsReplayedBitForBitByTheProgramAlone) {
  record();
  EXPECT_EQ(tachless(with_program({"replay", log("own")})), 0) << errors_;
  EXPECT_THAT(output_, HasSubstr("the same: 2000 commands, bit for bit"));
  EXPECT_EQ(replay_misbehaving("other"), 1);
  EXPECT_THAT(errors_, HasSubstr("1901 of 2000 commands differ, first at tick 99"));
  EXPECT_EQ(tachless({"replay", log("own")}), 2);
  EXPECT_THAT(errors_, HasSubstr("controller.law: external: the law is in a program of yours"));
}

TEST_F(ExternalLaw, IsComparedWithTheRecordedOne) {
  ASSERT_EQ(tachless(run("inside")), 0) << errors_;
  ASSERT_EQ(tachless(with_program({"replay", log("inside"), "--out", directory_ / "what_if"})), 0)
      << errors_;
  EXPECT_THAT(output_, AllOf(HasSubstr("recorded under loria_ortega_rigid, replayed under own_law "
                                       "(external)\n2000 ticks, 0 of them with another command")));
  ASSERT_EQ(tachless(with_program(run("own", {"--in-process"}))), 0) << errors_;
  ASSERT_EQ(tachless({"replay", log("own"), "--law", "loria_ortega_rigid"}), 0) << errors_;
  EXPECT_THAT(output_, HasSubstr("2000 ticks, 0 of them with another command"));
}

/// The analysis asks the program only for torques, at other periods too. It has no model of them.
TEST_F(ExternalLaw, IsCertifiedByItsAnswers) {
  const Words certify = {"certify", scenarios + "paper_rigid.yaml", "--json"};
  ASSERT_EQ(tachless(certify), 0) << errors_;
  const auto inside = base::parse_json(output_)["sampled"];
  ASSERT_EQ(tachless(with_program(certify)), 0) << errors_;
  const auto all = base::parse_json(output_);
  EXPECT_EQ(all["law"], "own_law (external)");
  const auto& own = all["sampled"];
  EXPECT_EQ(own["stable"], true);
  // Rounded torques of 1e3 N m over a deviation of 1e-6 rad give 1e-7 of gains of 1e4 N m/rad.
  for (const char* key : {"limit_s", "spectral_radius", "settling_s", "decay_per_s"}) {
    EXPECT_NEAR(own[key], inside[key], 1e-5 * inside[key].get<double>()) << key;
  }
  // The answers do not separate its compensation of gravity: 81 N m/rad beside 1e7 at high
  // frequency.
  for (const char* key : {"gain", "phase_deg", "delay_s", "modulus", "modulus_independent"}) {
    const double expected = inside["margins"][key];
    EXPECT_NEAR(own["margins"][key], expected, 1e-5 * expected) << key;
  }
  setenv("OWN_LAW", "kill", 1);
  EXPECT_EQ(tachless(with_program(certify)), 3);
  EXPECT_THAT(errors_, HasSubstr("was killed by signal 9 (Killed) at tick 99"));
}

/// The program's law has a prediction like a law in the library. A nonlinear law runs without one.
TEST_F(ExternalLaw, IsPredictedBeforeItRuns) {
  record();
  EXPECT_THAT(errors_, HasSubstr("stable at 20 kHz with 0 ticks of delay: limit 101.9 µs"));
  const auto summary = base::parse_json(contents(directory_ / "own/summary.json"));
  EXPECT_EQ(summary["predicted"]["stable"], true);
  const Words unstable = run("no", {"--set", "loop.period_s=0.0002"});
  EXPECT_EQ(tachless(with_program(unstable)), 2);
  EXPECT_THAT(errors_, HasSubstr("type --set loop.period_s=5e-05 or --force to run it as it is"));
  EXPECT_FALSE(fs::exists(directory_ / "no"));
  setenv("OWN_LAW", "coarse", 1);
  EXPECT_EQ(tachless(with_program(run("coarse", {"--any-outcome"}))), 0) << errors_;
  EXPECT_THAT(errors_, HasSubstr("no prediction: the law cannot be linearised (its answers do not "
                                 "superpose"));
  setenv("OWN_LAW", "exit", 1);
  EXPECT_EQ(tachless(with_program(run("no"))), 3);
  EXPECT_THAT(errors_, HasSubstr("ended with exit code 7 at tick 99"));
}

TEST_F(ExternalLaw, TellsHowTheProgramEnded) {
  record();
  EXPECT_EQ(replay_misbehaving("exit"), 3);
  EXPECT_THAT(errors_, HasSubstr("ended with exit code 7 at tick 99"));
  EXPECT_EQ(replay_misbehaving("kill"), 3);
  EXPECT_THAT(errors_, AllOf(HasSubstr("was killed by signal 9 (Killed) at tick 99"),
                             Not(HasSubstr("above"))));  // it wrote nothing
  EXPECT_EQ(replay_misbehaving("not finite"), 1);        // like a law in the library
  EXPECT_THAT(errors_, HasSubstr("the torque of joint 1 of law own_law at tick 99 is not finite"));
  EXPECT_EQ(replay_misbehaving("hang"), 3);
  EXPECT_THAT(errors_, HasSubstr("no answer at tick 99 within 5 s"));
  EXPECT_EQ(replay_misbehaving("other tick"), 4);
  EXPECT_THAT(errors_, HasSubstr("answered at tick 0 with a message of tick 1"));
  EXPECT_TRUE(support::children_of(getpid()).empty()) << "the program outlived the replay";
}

TEST_F(ExternalLaw, HasToBeTheOneOfTheScenario) {
  EXPECT_EQ(tachless(run("no", {"--set", "controller.law=external"})), 2);
  EXPECT_THAT(errors_, HasSubstr("controller.measurement: missing; needed with law: external"));
  const Words of_state = {"--set", "controller.law=external", "--set",
                          "controller.measurement=STATE"};
  EXPECT_EQ(tachless(run("no", of_state)), 2);
  EXPECT_THAT(errors_,
              HasSubstr("run, replay, certify and design take it with --controller 'PROGRAM'; "
                        "compare and sweep need one of tachless's laws"));
  EXPECT_EQ(tachless(with_program(run("no", of_state))), 2);
  EXPECT_THAT(errors_, HasSubstr("STATE, but the law own_law of this program needs POSITION"));
  EXPECT_EQ(tachless(with_program(run("no", {"--set", "controller.gains.stiffness=1"}))), 2);
  EXPECT_THAT(errors_, HasSubstr("own_law has no such gain; its gains: kp [N m/rad]"));
  EXPECT_EQ(tachless(run("no", {"--set", "controller.measurement=STATE"})), 2);
  EXPECT_THAT(errors_, HasSubstr("STATE, but the controller needs \"POSITION\""));
}

TEST_F(ExternalLaw, GetsNoMeasurementThatTheScenarioDoesNotName) {
  record();
  setenv("OWN_LAW", "state", 1);
  for (const Words& words : {run("no", {"--in-process"}), Words{"replay", log("own")}}) {
    EXPECT_EQ(tachless(with_program(words)), 2);
    EXPECT_THAT(errors_, HasSubstr("controller.measurement: POSITION, but the controller needs "
                                   "\"STATE\""));
  }
}

TEST_F(ExternalLaw, StopsTheRunByATorqueThatIsNotFinite) {
  setenv("OWN_LAW", "nan message", 1);
  EXPECT_EQ(tachless(with_program(run("no", {"--in-process"}))), 5);
  EXPECT_THAT(errors_, HasSubstr("its torque at tick 0 is not finite"));
}

/// Answers to earlier questions are still under way then.
TEST_F(ExternalLaw, IsNotAskedAgainWhenItHasFailed) {
  setenv("OWN_LAW", "nan message", 1);
  const scenario::Scenario scenario =
      scenario::load_scenario(scenarios + "paper_rigid.yaml",
                              {"controller.law=external", "controller.measurement=POSITION"});
  const messages::ReferencePoint reference = reference::make_trajectory(scenario).at(0);
  const std::vector<messages::AnyMeasurement> measured(
      20, messages::PositionMeasurement{reference.q_ref});
  controller::LawProgram law(scenario, program());
  for (int time = 0; time < 3; ++time) {
    EXPECT_THAT(
        [&] { law.answers(scenario.loop.period_s, Gravity::of_scenario, measured, reference); },
        ::testing::ThrowsMessage<base::Failure>(HasSubstr("its torque at tick 0 is not finite")))
        << time;
  }
}

/// A thread that asks may end. The kernel once ended the program with the thread that started it.
TEST_F(ExternalLaw, AnswersWithAndWithoutGravityFromAnyThread) {
  const scenario::Scenario scenario = scenario::load_scenario(
      scenarios + "ur5e.yaml", {"controller.law=external", "controller.measurement=POSITION"});
  const messages::ReferencePoint reference = reference::make_trajectory(scenario).at(0);
  const std::vector<messages::AnyMeasurement> measured(
      2, messages::PositionMeasurement{reference.q_ref});
  controller::LawProgram law(scenario, program());
  const auto torque = [&](Gravity gravity) {
    return std::async(
               std::launch::async,
               [&] { return law.answers(scenario.loop.period_s, gravity, measured, reference); })
        .get()
        .back();
  };
  const Vector weightless = torque(Gravity::nearly_zero), heavy = torque(Gravity::of_scenario);
  EXPECT_LT((heavy - weightless - robot::gravity_torque(*scenario.model, reference.q_ref))
                .cwiseAbs()
                .maxCoeff(),
            1e-6);  // of 9.81 m/s^2 1e-9 are left
  EXPECT_GT((heavy - weightless).cwiseAbs().maxCoeff(), 10);
  EXPECT_EQ(torque(Gravity::nearly_zero), weightless);
}

TEST_F(ExternalLaw, HasToTakePart) {
  EXPECT_EQ(tachless(run("no", {"--controller", "true"})), 3);
  EXPECT_THAT(errors_, HasSubstr("--controller 'true': ended at the start; does its main call"));
  EXPECT_EQ(tachless(run("no", {"--in-process", "--controller", "true"})), 3);
  EXPECT_THAT(errors_, HasSubstr("ended at the start; does its main call"));
  EXPECT_EQ(tachless(run("no", {"--controller", "no-such-program"})), 2);
  EXPECT_THAT(errors_, HasSubstr("no-such-program: not found"));
  EXPECT_EQ(tachless(run("no", {"--plant", "true", "--mode", "realtime"})), 3);
  EXPECT_THAT(errors_, HasSubstr("--plant 'true': ended without having taken part"));
}

/// A simulator may wait, as the emulator does. Here the simulator is the emulator.
TEST(ExternalPlant, LeavesTheLogOfTheEmulatorInLockstep) {
  const TemporaryDirectory directory;
  const auto log_of = [&](const char* name, const Words& more) {
    Words words = {"run",           scenarios + "practical_rigid.yaml",
                   "--duration",    "0.1",
                   "--run-id",      "7",
                   "--quiet",       "--out",
                   directory / name};
    words.insert(words.end(), more.begin(), more.end());
    Program program("tachless", words, directory.path());
    EXPECT_EQ(program.wait(), 0) << program.errors();
    return contents(directory / (std::string(name) + "/lcmlog"));
  };
  const std::string emulated = log_of("emulated", {});
  EXPECT_TRUE(emulated ==
              log_of("external", {"--plant", TACHLESS_BINARY_DIR "/bin/tachless-plant"}));
}

}  // namespace
}  // namespace tachless::external_law_test
