// examples/c_plant, compiled with lcm-gen's C types and LCM's library as its first lines say, runs
// without a key with the real reference, controller and logger.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <glob.h>
#include <map>
#include <string>
#include <vector>

#include "logger/log_file.h"
#include "tests/support/private_network.h"
#include "tests/support/program.h"

namespace tachless::c_plant_test {
namespace {

using Words = std::vector<std::string>;

const std::string source_directory = TACHLESS_SOURCE_DIR;

Words files_like(const std::string& pattern) {
  glob_t found{};
  Words result;
  if (::glob(pattern.c_str(), 0, nullptr, &found) == 0) {
    result.assign(found.gl_pathv, found.gl_pathv + found.gl_pathc);
  }
  ::globfree(&found);
  return result;
}

void run(const TemporaryDirectory& directory, const std::string& program, const Words& arguments) {
  Program each(program, arguments, directory.path());
  ASSERT_EQ(each.wait(), 0) << program << ": " << each.errors();
}

TEST(APlantInC, RunsWithTheOtherThreeWithoutAKey) {
  const TemporaryDirectory directory;
  const std::string folder = directory.path().string();
  Words types = {"-c", "--c-cpath", folder, "--c-hpath", folder};
  for (const std::string& type : files_like(source_directory + "/lcmtypes/*.lcm")) {
    types.push_back(type);
  }
  run(directory, "lcm-gen", types);
  Words compile = {"-std=gnu99", "-I" + folder, "-o", folder + "/plant",
                   source_directory + "/examples/c_plant/plant.c"};
  for (const std::string& type : files_like(folder + "/tachless_*.c")) compile.push_back(type);
  compile.emplace_back("-llcm");
  run(directory, "cc", compile);

  constexpr int num_ticks = 300;
  const std::string log = folder + "/lcmlog";
  const auto start = [&](const std::string& role, const Words& more = {}) {
    Words words = {source_directory + "/scenarios/practical_rigid.yaml"};
    for (const char* value :
         {"loop.mode=realtime", "loop.duration_s=0.3", "robot.gravity_m_per_s2=0",
          "controller.gains={kp: [100, 20], kd: [20, 5], a: [100, 100], b: [100, 100]}"}) {
      words.insert(words.end(), {"--set", value});
    }
    words.insert(words.end(), more.begin(), more.end());
    return Program("tachless-" + role, words, directory.path());
  };
  Program plant(folder + "/plant", {std::to_string(num_ticks), "0.001"}, directory.path());
  Program reference = start("reference");
  Program controller = start("controller");
  Program logger = start("logger", {"--out-log", log});
  EXPECT_EQ(plant.wait(), 0) << plant.errors() << logger.errors();
  EXPECT_EQ(reference.wait(), 0) << reference.errors();
  EXPECT_EQ(controller.wait(), 0) << controller.errors();
  EXPECT_EQ(logger.wait(), 0) << logger.errors();

  std::map<std::string, int> events;
  logger::LogReader reader(log);
  while (const auto event = reader.next()) ++events[std::string(event->channel)];
  EXPECT_EQ(events["ARM_RUN_INFO"], 1);
  // A busy machine may lose some.
  for (const char* channel : {"ARM_TICK", "ARM_POSITION", "ARM_COMMAND", "ARM_TRUTH"}) {
    EXPECT_GE(events[channel], num_ticks * 9 / 10) << channel;
  }
}

}  // namespace
}  // namespace tachless::c_plant_test
