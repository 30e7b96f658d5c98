// Runs on a bus with a key: strangers and replayed packets move nothing, and other keys are
// refused at the rendezvous.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <array>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "bus/udp_transport.h"
#include "bus/wire.h"
#include "tests/system/four_programs.h"

using namespace tachless;

namespace {

using system_test::FourPrograms;
using system_test::roles;
using system_test::scenarios;
using ::testing::AllOf;
using ::testing::HasSubstr;

struct Said {
  std::string channel;
  std::vector<std::byte> payload;
};

std::string key_file(const TemporaryDirectory& directory, char digit) {
  const std::string path = directory / (std::string("key") + digit);
  std::ofstream(path) << std::string(64, digit);
  chmod(path.c_str(), 0600);
  return path;
}

/// A run of two seconds of practical_rigid.yaml with these options; `stranger` is called with
/// everything that is heard on the bus, and may answer.
class WholeRun {
 public:
  explicit WholeRun(std::vector<std::string> options) : options_(std::move(options)) {
    programs.settings = {"--set", "loop.duration_s=2"};
  }
  void play(const std::function<void(bus::Transport&, const bus::Datagram&)>& stranger) {
    bus::UdpTransport bus;
    bus.subscribe_all();
    for (const char* role : roles) programs.start(role, options_);
    // All has been said when nothing has for longer than a heartbeat's period.
    while (const auto datagram = bus.receive(loop::Clock::now() + std::chrono::seconds(5))) {
      stranger(bus, *datagram);
    }
    programs.expect_all_done();
  }
  [[nodiscard]] std::string log() const { return contents(programs.log_path()); }
  [[nodiscard]] std::int64_t unauthenticated(const std::string& role) const {
    return nlohmann::json::parse(
        contents(programs.statistics_path(role)))["rejected"]["unauthenticated"];
  }
  FourPrograms programs{"practical_rigid.yaml"};

 private:
  std::vector<std::string> options_;
};

TEST(AKey, ChangesNothingInTheLogAndKeepsStrangersAndEarlierSessionsOut) {
  const TemporaryDirectory directory;
  const std::vector<std::string> keyed = {"--key-file", key_file(directory, '5')};

  WholeRun plain({});
  plain.play([](auto&, const auto&) {});
  ASSERT_FALSE(plain.log().empty());

  // Everything that is said in one session…
  std::vector<Said> earlier;
  WholeRun first(keyed);
  first.play([&](auto&, const bus::Datagram& heard) {
    earlier.push_back({std::string(heard.channel), {heard.payload.begin(), heard.payload.end()}});
  });
  EXPECT_TRUE(first.log() == plain.log());
  EXPECT_EQ(first.unauthenticated("plant"), 0);
  ASSERT_GT(earlier.size(), 10'000U);

  // …comes again in the next one of the same run, announcements too, with other commands that look
  // valid between.
  std::size_t next = 0;
  bus::Codec<loop::TorqueCommand> codec({.num_joints = 2, .num_motors = 0, .num_signals = 0});
  WholeRun second(keyed);
  second.play([&](bus::Transport& bus, const bus::Datagram& heard) {
    if (!heard.channel.ends_with("_TICK")) return;
    for (int i = 0; i < 6 && next < earlier.size(); ++i, ++next) {
      bus.publish(earlier[next].channel, earlier[next].payload);
    }
    loop::Stamp stamp{0, 7, 0};
    for (std::size_t i = 0; i < 8; ++i) {
      stamp.tick = stamp.tick << 8 | std::to_integer<std::int64_t>(heard.payload[24 + i]);
    }
    stamp.utime = 1000 * stamp.tick;
    const auto forged = codec.encode(stamp, {robot::Vector::Constant(2, 100)});
    std::vector<std::byte> tagged(forged.begin(), forged.end());
    bus.publish("ARM_COMMAND", tagged);
    tagged.resize(tagged.size() + 16, std::byte{0x5a});
    bus.publish("ARM_COMMAND", tagged);
  });
  EXPECT_TRUE(second.log() == plain.log());
  for (const char* role : roles) EXPECT_GT(second.unauthenticated(role), 100) << role;
}

TEST(WithoutAKey, TheSameForgedCommandEndsTheRun) {
  FourPrograms run("practical_rigid.yaml");
  run.settings = {"--set", "loop.duration_s=60"};
  bus::UdpTransport bus;
  bus.subscribe("ARM_COMMAND");
  run.start_all();
  const auto heard = bus.receive(loop::Clock::now() + std::chrono::seconds(30));
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
