// Troubles of a Franka arm in runs of the four programs, against an emulated arm: exit code, words,
// and an arm that stands still. TACHLESS_FRANKA_DRIVER names another driver program, such as one
// over the maker's library (bench/franka.sh).
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

#include "base/json_text.h"
#include "plant/drivers/franka/emulated_arm.h"
#include "tests/support/private_network.h"
#include "tests/system/four_programs.h"

namespace tachless::fci {
namespace {

using system_test::FourPrograms;
using testing::HasSubstr;

constexpr const char* fr3 = TACHLESS_SOURCE_DIR "/scenarios/fr3.yaml";

std::string driver_program() {
  const char* other = std::getenv("TACHLESS_FRANKA_DRIVER");
  return other != nullptr ? other : "tachless-franka-stand-in";
}

struct Case {
  std::string name{};
  int code = 0;         ///< of the driver's program
  std::string words{};  ///< in its messages
  Trouble trouble{};
  std::vector<std::string> settings{};
  Mode end = Mode::idle;
  bool moves = true;
};

std::ostream& operator<<(std::ostream& to, const Case& a) { return to << a.name; }

/// Runs with an emulated arm.
class FrankaRun : public testing::Test {
 protected:
  /// Starts arm and programs. No busy machine shall end a run by commands that it misses.
  void start(const Case& a) {
    std::vector<std::string> settings = {
        "plant.driver.address=127.0.0.1", "loop.command_delay=1", "loop.max_missed=400",
        "loop.max_missed_share=1",        "loop.duration_s=0.8",  "plant.following_error_rad=3"};
    settings.insert(settings.end(), a.settings.begin(), a.settings.end());
    arm_ = std::make_unique<EmulatedArm>(scenario::load_scenario(fr3, settings), Pace::patient,
                                         a.trouble);
    serving_ = std::jthread([this](const std::stop_token& ends) { arm_->serve(ends); });
    programs_ = std::make_unique<FourPrograms>("fr3.yaml");
    programs_->plant = driver_program();
    programs_->settings.clear();
    for (const std::string& each : settings) {
      programs_->settings.insert(programs_->settings.end(), {"--set", each});
    }
    programs_->start("plant");
    if (a.code != 2 || a.name == "beside_the_start") {
      for (const char* role : {"logger", "controller", "reference"}) programs_->start(role);
    }
  }
  Program& plant() { return (*programs_)["plant"]; }

  /// Waits for the driver, and expects its code and its words and an arm that stands still.
  void expect_end(const Case& a) {
    EXPECT_EQ(plant().wait(), a.code) << plant().errors();
    EXPECT_THAT(plant().errors(), HasSubstr(a.words));
    EXPECT_THAT(plant().errors(), testing::Not(HasSubstr("terminate")));
    programs_.reset();
    serving_ = {};
    EXPECT_EQ(arm_->mode(), a.end);
    EXPECT_EQ(arm_->speed(), 0);
    EXPECT_FALSE(arm_->has_client()) << "its connection is closed";
    EXPECT_EQ(arm_->motions(), a.moves ? 1 : 0);
    EXPECT_LE(arm_->largest_change_Nm(), 1);
    arm_.reset();
  }

  std::unique_ptr<EmulatedArm> arm_;
  std::jthread serving_;
  std::unique_ptr<FourPrograms> programs_;
};

class FrankaTrouble : public FrankaRun, public testing::WithParamInterface<Case> {};

TEST_P(FrankaTrouble, HasItsExitCodeAndWords) {
  start(GetParam());
  expect_end(GetParam());
}

Trouble begins(Mode mode) { return {.mode = mode}; }
Trouble at_300_ms(Event event, int count = 0) {
  return {.incidents = {{.at_ms = 300, .event = event, .count = count}}};
}
Incident torque_on(std::size_t joint, double torque_Nm) {
  return {.at_ms = 300, .event = Event::external_torque, .joint = joint, .torque_Nm = torque_Nm};
}

const std::vector<Case> refusals = {
    {"no_such_host",
     2,
     "plant.driver.address",
     {},
     {"plant.driver.address=no.such.host.invalid"},
     Mode::idle,
     false},
    {"interface_not_activated",
     2,
     "activate FCI in Desk",
     {},
     {"plant.driver.address=127.0.0.2"},
     Mode::idle,
     false},
    {"other_version", 2, "version 9 of its interface", {.version = 9}, {}, Mode::idle, false},
    {"in_a_reflex",
     2,
     "--set plant.driver.recover=true",
     begins(Mode::reflex),
     {},
     Mode::reflex,
     false},
    {"user_stop_pressed",
     2,
     "its user stop is pressed: release it",
     begins(Mode::user_stopped),
     {},
     Mode::user_stopped,
     false},
    {"guided", 2, "it is guided by hand", begins(Mode::guiding), {}, Mode::guiding, false},
    {"brakes_closed", 2, "open them in Desk", begins(Mode::other), {}, Mode::other, false},
    {"beside_the_start",
     2,
     "0 for joint 1 (joint1), which is at 0.05",
     {.offset_rad = 0.05},
     {},
     Mode::idle,
     false}};
INSTANTIATE_TEST_SUITE_P(BeforeTheMotion, FrankaTrouble, testing::ValuesIn(refusals),
                         testing::PrintToStringParamName());

const std::vector<Case> stops = {
    {"collision", 5, "joint_reflex", {.incidents = {torque_on(1, 40)}}, {}, Mode::reflex},
    {"user_stop",
     5,
     "its user stop was pressed",
     at_300_ms(Event::user_stop),
     {},
     Mode::user_stopped},
    {"commands_lost_25",
     5,
     "communication_constraints_violation",
     at_300_ms(Event::lose_commands, 25),
     {},
     Mode::reflex},
    {"states_lost_25",
     5,
     "communication_constraints_violation",
     at_300_ms(Event::lose_states, 25),
     {},
     Mode::reflex},
    {"push_and_commands_lost",
     5,
     "from its reference",
     {.incidents = {torque_on(1, 15), {.at_ms = 310, .event = Event::lose_commands, .count = 15}}},
     {"plant.following_error_rad=0.05", "loop.duration_s=1.5"}},
    {"too_fast", 5, "joint_velocity_violation", {.incidents = {torque_on(6, 9)}}, {}, Mode::reflex},
    {"connection_closed",
     5,
     "the connection to the arm at 127.0.0.1 is lost",
     at_300_ms(Event::close),
     {},
     Mode::reflex},
    {"arm_dies", 5, "but the robot stops by itself", at_300_ms(Event::die), {}, Mode::reflex},
    {"arm_freezes",
     5,
     "the connection to the arm at 127.0.0.1 is lost",
     at_300_ms(Event::freeze),
     {},
     Mode::reflex},
    {"reflex_without_an_answer",
     5,
     "joint_reflex",
     at_300_ms(Event::mute_reflex),
     {},
     Mode::reflex},
    {"friction_left_over",
     5,
     "joint 7 (joint7)",
     {.friction_Nm = 0.3},
     {"plant.following_error_rad=0.05", "loop.duration_s=2"}}};
INSTANTIATE_TEST_SUITE_P(InMotion, FrankaTrouble, testing::ValuesIn(stops),
                         testing::PrintToStringParamName());

const std::vector<Case> runs = {
    {"recovery_from_a_reflex",
     0,
     "the arm was in a reflex and has recovered",
     begins(Mode::reflex),
     {"plant.driver.recover=true"}},
    {"commands_lost_15", 0, "", at_300_ms(Event::lose_commands, 15)},
    {"states_lost_15", 0, "", at_300_ms(Event::lose_states, 15)},
    {"commands_lost_5_percent", 0, "", {.lost_share = 0.05}},
    {"commands_lost_30_percent", 0, "", {.lost_share = 0.3}},
    {"dry_run", 0, "", {.offset_rad = 0.3}, {"plant.dry_run=true"}, Mode::idle, false},
    {"stop_that_the_arm_rejects_later", 0, "", {.refuses_late_stop = true}}};
INSTANTIATE_TEST_SUITE_P(WithoutAStop, FrankaTrouble, testing::ValuesIn(runs),
                         testing::PrintToStringParamName());

/// Processes that end or stand still in motion. Each test starts from `moving`.
class FrankaProcess : public FrankaRun {
 protected:
  void start_and_move(const std::vector<std::string>& more = {}) {
    std::vector<std::string> settings = {"loop.duration_s=60", "loop.max_missed=100"};
    settings.insert(settings.end(), more.begin(), more.end());
    start({.name = "process", .settings = settings});
    wait_until("the log grows", [&] { return programs_->log_size() > 50'000; });
  }
};

TEST_F(FrankaProcess, ControllerThatIsKilledStopsTheArm) {
  start_and_move();
  (*programs_)["controller"].signal(SIGKILL);
  expect_end({.code = 5, .words = "did not come in time"});
}

TEST_F(FrankaProcess, ControllerThatStandsStillStopsTheArm) {
  start_and_move();
  (*programs_)["controller"].signal(SIGSTOP);
  expect_end({.code = 5, .words = "did not come in time"});
}

TEST_F(FrankaProcess, InterruptionBrakesTheArm) {
  start_and_move();
  plant().signal(SIGINT);
  expect_end({.code = 130, .words = "interrupted"});
}

TEST_F(FrankaProcess, DriverThatIsKilledLeavesAnArmThatStopsItself) {
  start_and_move();
  plant().signal(SIGKILL);
  expect_end({.code = 128 + SIGKILL, .words = "", .end = Mode::reflex});
}

/// The emulated arm waits 40 ms for each of 21 commands.
TEST_F(FrankaProcess, DriverThatStandsStillFindsAnArmThatHasStopped) {
  start_and_move();
  plant().signal(SIGSTOP);
  std::this_thread::sleep_for(std::chrono::milliseconds(1500));
  plant().signal(SIGCONT);
  expect_end({.code = 5, .words = "", .end = Mode::reflex});
}

TEST_F(FrankaRun, IsReplayedBitForBitAndHasTheDriversFigures) {
  const Case whole{.name = "whole", .trouble = at_300_ms(Event::lose_states, 5)};
  start(whole);
  for (const char* role : {"logger", "controller", "reference"}) {
    EXPECT_EQ((*programs_)[role].wait(), 0) << (*programs_)[role].errors();
  }
  EXPECT_EQ(plant().wait(), 0) << plant().errors();
  const auto statistics = base::parse_json(contents(programs_->statistics_path("plant")));
  const std::string text = base::json_text(statistics);
  for (const char* figure : {"success_rate_mean", "success_rate_lowest", "torques_limited",
                             "answer_median_us", "end_effector_kg", "load_kg"}) {
    EXPECT_THAT(text, HasSubstr(figure));
  }
  Program replay("tachless", {"replay", programs_->log_path()}, programs_->directory().path());
  EXPECT_EQ(replay.wait(), 0) << replay.errors();
  EXPECT_THAT(replay.output(), HasSubstr("bit for bit"));
  expect_end(whole);
}

TEST(FrankaProgram, EmulatesAnArmAndPrintsItsModel) {
  const TemporaryDirectory directory;
  const auto ends = [&](const std::vector<std::string>& words, int code, const std::string& text) {
    Program program(driver_program(), words, directory.path());
    EXPECT_EQ(program.wait(), code) << program.errors();
    EXPECT_THAT(program.output() + program.errors(), HasSubstr(text));
  };
  ends({"--help"}, 0, "tachless-franka urdf 172.16.0.2");
  ends({"urdf"}, 2, "the address is missing; type: tachless-franka urdf");
  ends({"emulate"}, 2, "the scenario is missing; type: tachless-franka emulate");
  Program arm(driver_program(), {"emulate", fr3}, directory.path());
  wait_until("the arm listens", [&] {
    Program urdf(driver_program(), {"urdf", "127.0.0.1"}, directory.path());
    return urdf.wait() == 0 && urdf.output().find("joint7") != std::string::npos;
  });
  arm.signal(SIGINT);
  EXPECT_EQ(arm.wait(), 0) << arm.errors();
}

}  // namespace
}  // namespace tachless::fci
