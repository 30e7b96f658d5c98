// Four nodes whose plant is MuJoCo: the same log whatever the network loses.

#include <gtest/gtest.h>

#include <cstdlib>
#include <string>

#include "logger/run_log.h"
#include "replay/replay.h"
#include "tests/system/four_threads.h"

namespace tachless::system_test {
namespace {

scenario::Scenario box_on_a_table() {
  setenv("TACHLESS_MUJOCO", TACHLESS_BINARY_DIR "/lib/tachless/mujoco.so", 1);
  return scenario::load_scenario(TACHLESS_SOURCE_DIR "/examples/mujoco/push_box.yaml",
                                 {"loop.duration_s=1.2"});
}

TEST(MujocoLoop, HasTheSameLogWhateverTheNetworkLoses) {
  const scenario::Scenario scenario = box_on_a_table();
  const RunResult clean = run(scenario),
                  lossy = run(scenario, {.loss = 0.1, .duplication = 0.1, .seed = 3});
  ASSERT_EQ(clean.complaints(), "");
  ASSERT_EQ(lossy.complaints(), "");
  EXPECT_TRUE(lossy.log == clean.log);
  EXPECT_GT(lossy.of.at(messages::Role::plant).statistics.resends, 0);
  EXPECT_NE(clean.log.find("paddle, box"), std::string::npos);
}

TEST(MujocoLoop, IsReplayedWithTheVersionOfMujoco) {
  const scenario::Scenario scenario = box_on_a_table();
  FourThreads threads(scenario);
  ASSERT_EQ(threads.finish().complaints(), "");
  setenv("TACHLESS_MUJOCO", "/none/mujoco.so", 1);  // a replay needs no MuJoCo
  logger::RunLog log = logger::RunLog::open(threads.log_path());
  const auto found = replay::replay(log, log.scenario(), controller::scenario_law(log.scenario()));
  EXPECT_EQ(replay::problem_text(found, log, robot::joint_labels(*scenario.model)), "");
  EXPECT_TRUE(found.simulator.starts_with("MuJoCo ")) << found.simulator;
  EXPECT_NE(replay::verified_text(found, log, 1).find(", plant MuJoCo "), std::string::npos);
}

}  // namespace
}  // namespace tachless::system_test
