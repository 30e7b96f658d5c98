#include "cli/supervise.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <map>

#include "tests/support/temporary_directory.h"

namespace tachless::cli::supervise_test {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using Clock = std::chrono::steady_clock;

Process shell(const std::string& name, const std::string& script) {
  return {name, {"/bin/sh", "-c", script}};
}

// Ends at once on SIGTERM, on SIGINT with 130, and says so.
const std::string obedient =
    "trap 'echo closing; exit 130' INT; trap 'echo closing; exit 0' TERM; "
    "echo up; while :; do sleep 0.02; done";
const std::string deaf = "trap '' INT TERM; echo up; while :; do sleep 0.02; done";

struct Result {
  Supervision supervision;
  std::map<std::string, std::vector<std::string>> lines;
  Clock::duration took{};
};

/// `act(lines)` is called on each wake and may send signals.
Result watch(const std::vector<Process>& processes,
             const std::function<void(const Result&)>& act = {}, SuperviseOptions options = {}) {
  Result result;
  options.on_line = [&](std::string_view name, std::string_view line) {
    result.lines[std::string(name)].emplace_back(line);
  };
  options.on_wake = [&] {
    if (act) act(result);
  };
  const auto begun = Clock::now();
  result.supervision = supervise({{processes, options}}).front();
  result.took = Clock::now() - begun;
  return result;
}

bool up(const Result& result, const std::string& name) {
  const auto found = result.lines.find(name);
  return found != result.lines.end() && !found->second.empty();
}

TEST(Supervise, ReturnsWhenAllHaveEndedWell) {
  const Result result = watch({shell("plant", "echo one; echo two >&2; exit 0"),
                               shell("controller", "printf 'no newline'")});
  EXPECT_FALSE(result.supervision.culprit.has_value());
  EXPECT_EQ(exit_code(result.supervision), base::ExitCode::done);
  EXPECT_THAT(result.lines.at("plant"), ElementsAre("one", "two"));
  EXPECT_THAT(result.lines.at("controller"), ElementsAre("no newline"));
}

TEST(Supervise, EndsTheRunWhenOneIsKilled) {
  const Result result =
      watch({shell("plant", deaf), shell("controller", "echo $$; echo ready; kill -9 $$"),
             shell("logger", obedient)});
  EXPECT_LT(result.took, seconds(50));
  ASSERT_EQ(result.supervision.culprit, 1U);
  EXPECT_EQ(exit_code(result.supervision), base::ExitCode::peer_lost);
  EXPECT_EQ(describe(result.supervision.ends[1]),
            "controller was killed by signal 9 (Killed): ready");
  EXPECT_EQ(result.supervision.ends[0].signal, SIGKILL);
  EXPECT_EQ(result.supervision.ends[2].exit_code, 0) << "the logger closes its log on SIGTERM";
}

TEST(Supervise, PassesOnTheCulpritsExitCodeAndLastWords) {
  const Result result =
      watch({shell("plant", "echo 'tau_1 is not finite' >&2; exit 5"), shell("logger", obedient)});
  ASSERT_EQ(result.supervision.culprit, 0U);
  EXPECT_EQ(exit_code(result.supervision), base::ExitCode::protective_stop);
  EXPECT_EQ(describe(result.supervision.ends[0]),
            "plant ended with exit code 5: tau_1 is not finite");
}

TEST(Supervise, KeepsTheCauseThatAProcessGivesAndPassesOtherLinesOn) {
  const Result result = watch(
      {shell("plant",
             "echo '<warning> tachless-plant: late'; echo '<error> tachless-plant: tau: nan'; exit "
             "5"),
       shell("logger",
             "sleep 0.1; echo '<error> tachless-logger: ended because of the plant'; exit 3")});
  EXPECT_THAT(result.lines.at("plant"), ElementsAre("late"));
  EXPECT_EQ(result.lines.count("logger"), 0U);
  ASSERT_EQ(result.supervision.culprit, 0U);
  EXPECT_EQ(describe(result.supervision.ends[0]), "plant: tau: nan");
  EXPECT_EQ(others_that_failed(result.supervision), "logger (exit code 3)");
}

TEST(Supervise, PassesDetailsOnWithoutTheirMarkAndTakesNoneForACause) {
  const Result result =
      watch({shell("logger",
                   "echo '<warning> tachless-logger: a slow disk'; echo '<info> tachless-logger: "
                   "waiting'; echo '<debug> tachless-logger: bus'; kill -9 $$"),
             shell("plant", obedient)});
  EXPECT_THAT(result.lines.at("logger"), ElementsAre("a slow disk", "waiting", "bus"));
  EXPECT_EQ(describe(result.supervision.ends[0]),
            "logger was killed by signal 9 (Killed): a slow disk");
}

TEST(Supervise, LetsTheOthersEndByThemselvesWhenACheckSaidNo) {
  SuperviseOptions options;
  options.grace = milliseconds(50);
  const Result result =
      watch({shell("plant", "exit 1"), shell("logger", "sleep 0.5; echo whole")}, {}, options);
  EXPECT_EQ(exit_code(result.supervision), base::ExitCode::check_said_no);
  EXPECT_THAT(result.lines.at("logger"), ElementsAre("whole"));
  EXPECT_FALSE(result.supervision.ends[1].on_order);
}

SuperviseOptions before_the_run() {
  SuperviseOptions options;
  options.grace = milliseconds(50);
  options.begun = [] { return false; };
  return options;
}

TEST(Supervise, DoesNotTakeTheCodeOfADriverThatEndsBeforeTheRunForACheck) {
  const Result result =
      watch({shell("plant", "exit 1"), shell("logger", obedient)}, {}, before_the_run());
  EXPECT_EQ(result.supervision.culprit, 0U);
  EXPECT_EQ(exit_code(result.supervision), base::ExitCode::peer_lost);
  EXPECT_TRUE(result.supervision.ends[1].on_order);
}

TEST(Supervise, DoesNotLetTheOthersWaitForADriverThatEndsWellBeforeTheRun) {
  const SuperviseOptions options = before_the_run();
  const Result result = watch({shell("plant", "exit 0"), shell("logger", obedient)}, {}, options);
  EXPECT_LT(result.took, options.end_together) << "what the others get after a run";
  EXPECT_TRUE(result.supervision.ends[1].on_order);
}

// A Python program that cannot be imported ends with code 1.
TEST(Supervise, DoesNotTakeACodeOfAUsersControllerForACheckOfThePlant) {
  SuperviseOptions options;
  options.grace = milliseconds(50);
  const Result result =
      watch({shell("plant", obedient), shell("controller", "exit 1")}, {}, options);
  EXPECT_EQ(result.supervision.culprit, 1U);
  EXPECT_TRUE(result.supervision.ends[0].on_order);
  EXPECT_FALSE(result.supervision.ends[0].overdue);
}

TEST(Supervise, TellsOfAProtectiveStopWhoeverWasLost) {
  SuperviseOptions options;
  options.grace = seconds(2);
  const Result result =
      watch({shell("plant", "sleep 0.2; exit 5"), shell("controller", "kill -9 $$"),
             shell("logger", "exec sleep 0.3")},
            {}, options);
  ASSERT_EQ(result.supervision.culprit, 1U) << "the cause is still the one that was lost";
  EXPECT_EQ(exit_code(result.supervision), base::ExitCode::protective_stop);
}

TEST(Supervise, BlamesTheCauseNotThePeerThatMissedIt) {
  SuperviseOptions options;
  options.grace = seconds(2);
  const Result result =
      watch({shell("plant", "exit 3"), shell("controller", "sleep 0.1; exit 4")}, {}, options);
  ASSERT_EQ(result.supervision.culprit, 1U);
  EXPECT_EQ(exit_code(result.supervision), base::ExitCode::protocol_violated);
}

TEST(Supervise, BlamesWhoMissedAPeerBeforeWhoHeardOfIt) {
  SuperviseOptions options;
  options.grace = seconds(2);
  const Result result =
      watch({shell("reference",
                   "echo '<error> tachless-reference: ended because of the plant: silent'; exit 3"),
             shell("plant", "sleep 0.1; echo '<error> tachless-plant: silent'; exit 3")},
            {}, options);
  ASSERT_EQ(result.supervision.culprit, 1U);
  EXPECT_EQ(describe(result.supervision.ends[1]), "plant: silent");
  EXPECT_EQ(exit_code(result.supervision), base::ExitCode::peer_lost);
}

TEST(Supervise, GivesTheOthersTimeToEndByThemselves) {
  const Result result = watch({shell("plant", "exit 5"), shell("logger", "sleep 0.1; exit 5")});
  EXPECT_FALSE(result.supervision.ends[1].on_order);
  EXPECT_EQ(result.supervision.ends[1].exit_code, 5);
}

TEST(Supervise, PassesCtrlCOnOnceAndEndsWith130) {
  bool sent = false;
  const Result result =
      watch({shell("plant", obedient), shell("logger", obedient)}, [&](const Result& so_far) {
        if (sent || !up(so_far, "plant") || !up(so_far, "logger")) return;
        sent = true;
        kill(getpid(), SIGINT);
      });
  EXPECT_TRUE(result.supervision.interrupted);
  EXPECT_EQ(exit_code(result.supervision), base::ExitCode::interrupted);
  EXPECT_THAT(result.lines.at("plant"), ElementsAre("up", "closing"));
  EXPECT_EQ(result.supervision.ends[0].exit_code, 130);
  EXPECT_EQ(result.supervision.ends[1].exit_code, 130);
}

TEST(Supervise, KillsTheDeafAfterASecondCtrlC) {
  int sent = 0;
  const Result result = watch({shell("plant", deaf)}, [&](const Result& so_far) {
    if (sent == 2 || !up(so_far, "plant")) return;
    ++sent;
    kill(getpid(), SIGINT);
  });
  EXPECT_LT(result.took, seconds(18));
  EXPECT_EQ(result.supervision.ends[0].signal, SIGKILL);
  EXPECT_EQ(exit_code(result.supervision), base::ExitCode::interrupted);
}

TEST(Supervise, PassesCtrlCOnToWhoIsDeafToSigterm) {
  const std::string hears_interrupts =
      "trap 'echo told' TERM; trap 'exit 130' INT; echo up; while :; do sleep 0.02; done";
  SuperviseOptions options;
  options.patience = seconds(20);
  bool sent = false;
  const Result result = watch(
      {shell("plant", hears_interrupts), shell("controller", "sleep 0.2; exit 4")},
      [&](const Result& so_far) {
        const auto plant = so_far.lines.find("plant");
        if (sent || plant == so_far.lines.end() || plant->second.back() != "told") return;
        sent = true;
        kill(getpid(), SIGINT);
      },
      options);
  EXPECT_LT(result.took, seconds(50));
  EXPECT_EQ(result.supervision.ends[0].exit_code, 130);
  EXPECT_EQ(exit_code(result.supervision), base::ExitCode::interrupted);
}

TEST(Supervise, StopsWhoGoesOnLongAfterTheOthersHaveEnded) {
  SuperviseOptions options;
  options.end_together = milliseconds(200);
  const Result result =
      watch({shell("plant", "exit 0"), shell("controller", obedient)}, {}, options);
  ASSERT_EQ(result.supervision.culprit, 1U);
  EXPECT_EQ(exit_code(result.supervision), base::ExitCode::peer_lost);
  EXPECT_THAT(describe(result.supervision.ends[1]), HasSubstr("still running after the others"));
}

TEST(Supervise, WakesAStoppedProcessToEndIt) {
  const Result result =
      watch({shell("plant", "trap 'exit 0' TERM; echo up; kill -STOP $$; sleep 60"),
             shell("controller", "sleep 0.2; exit 4")});
  EXPECT_LT(result.took, seconds(50));
  EXPECT_EQ(result.supervision.culprit, 1U);
}

TEST(Supervise, NamesAProgramThatCannotBeStarted) {
  pid_t first = 0;
  SuperviseOptions options;
  options.on_line = [&](std::string_view, std::string_view line) {
    first = static_cast<pid_t>(std::stol(std::string(line)));
  };
  try {
    supervise({{{shell("plant", "echo $$; sleep 60"), {"logger", {"/nowhere/tachless-logger"}}},
                options}});
    FAIL() << "started a program that is not there";
  } catch (const base::Failure& failure) {
    EXPECT_EQ(failure.code(), base::ExitCode::bad_usage);
    EXPECT_THAT(failure.what(), HasSubstr("cannot start /nowhere/tachless-logger"));
  }
  EXPECT_EQ(waitpid(-1, nullptr, WNOHANG), -1) << "a child was left behind";
}

TEST(SuperviseSeveral, InterruptsTheOthersWhenOneFails) {
  const TemporaryDirectory directory;
  const std::string is_up = directory / "up";
  const auto ends = supervise(std::vector<Supervised>{
      {{shell("plant", obedient),
        shell("logger", "trap 'exit 130' INT; touch " + is_up + "; while :; do sleep 0.02; done")},
       {}},
      {{shell("plant", obedient),
        shell("controller", "until [ -e " + is_up + " ]; do sleep 0.02; done; exit 5")},
       {}}});
  ASSERT_EQ(ends.size(), 2U);
  EXPECT_TRUE(ends[1].failed());
  EXPECT_EQ(ends[1].culprit, 1U);
  EXPECT_EQ(exit_code(ends[1]), base::ExitCode::protective_stop);
  EXPECT_FALSE(ends[1].because_of.has_value());
  EXPECT_FALSE(ends[0].failed());
  EXPECT_EQ(ends[0].because_of, 1U);
  EXPECT_EQ(exit_code(ends[0]), base::ExitCode::interrupted);
  EXPECT_EQ(ends[0].ends[1].exit_code, 130) << "it was to end in order, by SIGINT";
}

TEST(SuperviseSeveral, LetsTheOthersGoOnWhenOneEndsByItself) {
  for (const int code : {0, 1}) {  // well, and with a check that said no
    SuperviseOptions options;
    options.end_together = milliseconds(50);
    const auto ends = supervise(std::vector<Supervised>{
        {{shell("plant", "exit " + std::to_string(code))}, options},
        {{shell("plant", "sleep 0.5; exit 0"), shell("logger", "sleep 0.5; exit 0")}, {}}});
    EXPECT_EQ(static_cast<int>(exit_code(ends[0])), code);
    EXPECT_FALSE(ends[1].interrupted) << code;
    EXPECT_EQ(exit_code(ends[1]), base::ExitCode::done) << code;
  }
}

TEST(SuperviseSeveral, PassesCtrlCOnToAll) {
  std::array<bool, 2> up{};
  std::vector<Supervised> runs;
  for (bool& each : up) {
    SuperviseOptions options;
    options.on_line = [&](std::string_view, std::string_view) { each = true; };
    options.on_wake = [&, sent = false]() mutable {
      if (sent || !up[0] || !up[1] || &each != up.data()) return;
      sent = true;
      kill(getpid(), SIGINT);
    };
    runs.push_back({{shell("plant", obedient)}, options});
  }
  for (const Supervision& end : supervise(runs)) {
    EXPECT_TRUE(end.interrupted);
    EXPECT_FALSE(end.because_of.has_value());
    EXPECT_EQ(end.ends[0].exit_code, 130);
  }
}

TEST(SuperviseSeveral, LeavesNoChildWhenAProgramOfALaterRunCannotBeStarted) {
  EXPECT_THROW(supervise(std::vector<Supervised>{{{shell("plant", "exec sleep 60")}, {}},
                                                 {{{"logger", {"/nowhere/tachless-logger"}}}, {}}}),
               base::Failure);
  EXPECT_EQ(waitpid(-1, nullptr, WNOHANG), -1) << "a child was left behind";
}

TEST(Supervise, LeavesNoChildWhenItDies) {
  std::array<int, 2> held{};  // its writing end is open as long as launcher or child live
  ASSERT_EQ(pipe(held.data()), 0);
  const pid_t launcher = fork();
  ASSERT_GE(launcher, 0);
  if (launcher == 0) {
    SuperviseOptions options;
    options.on_line = [&](std::string_view, std::string_view) {
      [[maybe_unused]] const auto n = write(held[1], "u", 1);
    };
    supervise({{{shell("plant", "echo up; exec sleep 60")}, options}});
    _exit(0);
  }
  close(held[1]);
  char up = 0;
  ASSERT_EQ(read(held[0], &up, 1), 1);
  ASSERT_EQ(kill(launcher, SIGKILL), 0);
  waitpid(launcher, nullptr, 0);
  pollfd closed{held[0], POLLIN, 0};
  EXPECT_EQ(poll(&closed, 1, 5000), 1) << "the child outlived its launcher";
  close(held[0]);
}

TEST(Supervise, LeavesSignalsAsTheyWere) {
  sigset_t before, after;
  sigprocmask(SIG_BLOCK, nullptr, &before);
  watch({shell("plant", "exit 0")});
  sigprocmask(SIG_BLOCK, nullptr, &after);
  EXPECT_EQ(sigismember(&before, SIGINT), sigismember(&after, SIGINT));
  EXPECT_EQ(sigismember(&before, SIGCHLD), sigismember(&after, SIGCHLD));
}

// A driver whose read hangs: says that it starts its robot, is deaf, and stops it after `seconds`.
Process blocked_driver(const std::string& seconds) {
  Process driver = shell(
      "plant", "trap '' INT TERM; printf s >/proc/self/fd/$TACHLESS_NOTICE_FD; echo up; sleep " +
                   seconds + "; printf e >/proc/self/fd/$TACHLESS_NOTICE_FD; exit 5");
  driver.drives_robot = true;
  return driver;
}

TEST(Supervise, LetsADriverStopItsRobotHoweverLongThatTakes) {
  SuperviseOptions options;
  options.patience = milliseconds(100);
  const Result result =
      watch({blocked_driver("3"), shell("controller", "sleep 0.3; exit 3")}, {}, options);
  EXPECT_EQ(result.supervision.ends[0].signal, 0);
  EXPECT_EQ(result.supervision.ends[0].exit_code, 5);
  EXPECT_TRUE(result.supervision.ends[0].robot_stopped);
  EXPECT_EQ(exit_code(result.supervision), base::ExitCode::protective_stop);
  EXPECT_THAT(result.lines.at("plant"), ::testing::Contains(HasSubstr("use the emergency stop")));
}

TEST(Supervise, KillsADriverThatHoldsItsRobotOnTheThirdSignalAlone) {
  int sent = 0;
  Clock::time_point last{};
  const Result result = watch({blocked_driver("600")}, [&](const Result& so_far) {
    if (!up(so_far, "plant") || sent == 3 || Clock::now() - last < milliseconds(500)) return;
    last = Clock::now();
    kill(getpid(), SIGINT);
    ++sent;
  });
  EXPECT_EQ(sent, 3);
  EXPECT_EQ(result.supervision.ends[0].signal, SIGKILL);
  EXPECT_TRUE(result.supervision.ends[0].robot_started);
  EXPECT_FALSE(result.supervision.ends[0].robot_stopped);
}

TEST(Supervise, AttendsToSignalsDuringAFloodThatNeverEnds) {
  Process flood = shell("plant", "echo up; exec yes");
  for (const bool relayed : {false, true}) {
    flood.relayed = relayed;
    SuperviseOptions options;
    options.most_lines_per_s = 20;
    bool sent = false;
    const Result result = watch(
        {flood},
        [&](const Result& so_far) {
          if (sent || !up(so_far, "plant") || so_far.lines.at("plant").size() < 20) return;
          sent = true;
          kill(getpid(), SIGINT);
        },
        options);
    EXPECT_TRUE(result.supervision.interrupted);
    EXPECT_EQ(result.supervision.ends[0].signal, SIGINT);
    EXPECT_GT(result.supervision.ends[0].hidden_lines, 0);
  }
}

TEST(Supervise, DoesNotMakeARelayedProcessWaitForThisOne) {
  const TemporaryDirectory directory;
  Process chatty = shell("plant", "yes | head -c 4000000; touch " + (directory / "done").string() +
                                      "; echo '<error> the end'");
  chatty.relayed = true;
  bool first = true;
  const Result result = watch({chatty}, [&](const Result&) {
    if (!std::exchange(first, false)) return;
    while (!std::filesystem::exists(directory / "done")) usleep(1000);  // nobody reads
  });
  EXPECT_GT(result.supervision.ends[0].dropped_bytes, 0);
  EXPECT_EQ(result.supervision.ends[0].cause, "the end");
}

TEST(Supervise, TakesAUsersExitCodeOfOneForALostPeer) {
  const Result result = watch({shell("plant", "sleep 0.1; exit 5"), shell("controller", "exit 1")});
  EXPECT_EQ(exit_code(result.supervision), base::ExitCode::protective_stop);
}

}  // namespace
}  // namespace tachless::cli::supervise_test
