// A key that differs or is missing is refused at the rendezvous; without keys a forged command ends
// the run. What a key keeps out, tests/campaign shows.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <array>
#include <fstream>
#include <string>
#include <vector>

#include "bus/udp_transport.h"
#include "messages/wire.h"
#include "tests/system/four_programs.h"

namespace tachless::authenticated_test {
namespace {

using system_test::FourPrograms;
using system_test::roles;
using system_test::scenarios;
using ::testing::AllOf;
using ::testing::HasSubstr;

std::string key_file(const TemporaryDirectory& directory, char digit) {
  const std::string path = directory / (std::string("key") + digit);
  std::ofstream(path) << std::string(64, digit);
  chmod(path.c_str(), 0600);
  return path;
}

TEST(WithoutAKey, TheSameForgedCommandEndsTheRun) {
  FourPrograms run("practical_rigid.yaml");
  run.settings = {"--set", "loop.duration_s=60"};
  bus::UdpTransport bus;
  bus.subscribe("ARM_COMMAND");
  run.start_all();
  const auto heard = bus.receive(base::Clock::now() + std::chrono::seconds(30));
  ASSERT_TRUE(heard);
  std::vector<std::byte> forged(heard->payload.begin(), heard->payload.end());
  forged.back() ^= std::byte{1};
  bus.publish("ARM_COMMAND", forged);
  EXPECT_EQ(run["plant"].wait(), 4);
  EXPECT_THAT(run["plant"].errors(), HasSubstr("two processes"));
}

TEST(AKey, ThatIsAnotherOrMissingIsRefusedOnBothSides) {
  const TemporaryDirectory directory;
  const std::string scenario = scenarios + "practical_rigid.yaml";
  const std::string five = key_file(directory, '5');
  const std::string six = key_file(directory, '6');
  struct Case {
    std::vector<std::string> plant, controller;
    std::string plant_says, controller_says;
  };
  const std::array cases = {
      Case{{"--key-file", five},
           {"--key-file", six},
           "has another key than this plant",
           "has another key than this controller"},
      Case{{"--key-file", five}, {}, "has no key", "has a key, this controller has none"},
      Case{{}, {"--key-file", five}, "has a key, this plant has none", "has no key"}};
  for (const Case& each : cases) {
    std::vector<std::string> plant_words = {scenario, "--wait-s", "30"};
    std::vector<std::string> controller_words = plant_words;
    plant_words.insert(plant_words.end(), each.plant.begin(), each.plant.end());
    controller_words.insert(controller_words.end(), each.controller.begin(), each.controller.end());
    Program plant("tachless-plant", plant_words, directory.path());
    Program controller("tachless-controller", controller_words, directory.path());
    EXPECT_EQ(plant.wait(), 4);
    EXPECT_EQ(controller.wait(), 4);
    EXPECT_THAT(plant.errors(), AllOf(HasSubstr("--key-file"), HasSubstr(each.plant_says)));
    EXPECT_THAT(controller.errors(),
                AllOf(HasSubstr("--key-file"), HasSubstr(each.controller_says)));
  }
}

TEST(AKey, ThatCannotBeReadIsRefusedAtOnce) {
  const TemporaryDirectory directory;
  Program plant("tachless-plant",
                {scenarios + "practical_rigid.yaml", "--key-file", directory / "nowhere"},
                directory.path());
  EXPECT_EQ(plant.wait(), 2);
  EXPECT_THAT(plant.errors(), HasSubstr("--key-file: " + (directory / "nowhere").string()));
}

}  // namespace
}  // namespace tachless::authenticated_test
