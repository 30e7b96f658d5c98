// These tests use the installation that install.sh made, from outside of the tree.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "logger/run_log.h"
#include "tests/support/private_network.h"
#include "tests/support/program.h"
#include "tests/support/shell.h"
#include "tests/support/temporary_directory.h"

namespace tachless::installed_test {
namespace {

namespace fs = std::filesystem;
using support::Outcome;
using ::testing::HasSubstr;

const std::string prefix = TACHLESS_BINARY_DIR "/installed/";

class Installed : public testing::Test {
 protected:
  /// Runs `command` as if typed in a shell, in a directory that is empty at first.
  Outcome type(const std::string& command) {
    return support::shell(
        "cd " + directory_.path().string() + " && PATH=" + prefix +
        "bin:/usr/bin:$PATH PYTHONDONTWRITEBYTECODE=1 PYTHONPATH=" + prefix +
        "lib/python3/dist-packages && export PYTHONPATH PYTHONDONTWRITEBYTECODE && " + command);
  }
  std::vector<Vector> torques(const std::string& log) {
    std::vector<Vector> result;
    logger::RunLog run = logger::RunLog::open(directory_ / log);
    logger::TickRecord record;
    while (run.next(record)) result.push_back(record.command.value().tau);
    return result;
  }

  TemporaryDirectory directory_;
};

TEST_F(Installed, RunsAScenarioThatIsNoFileHereByItsName) {
  for (const std::string name : {"paper_rigid", "scenarios/paper_rigid.yaml"}) {
    const Outcome run = type("tachless run --duration 0.01 " + name);
    EXPECT_EQ(run.exit_code, 0) << run.output;
    EXPECT_EQ(torques("out/paper_rigid/latest/lcmlog").size(), 200U);
  }
  EXPECT_EQ(type("tachless robot robots/two_link.urdf").exit_code, 0);
}

TEST_F(Installed, PrefersTheFileThatIsHere) {
  std::ofstream(directory_ / "paper_rigid") << "name: mine\n";
  EXPECT_THAT(type("tachless certify paper_rigid").output, HasSubstr("robot.urdf: missing"));
}

TEST_F(Installed, SaysWhereItHasLookedForAScenario) {
  const Outcome outcome = type("tachless run paper_riged");
  EXPECT_EQ(outcome.exit_code, 2);
  EXPECT_THAT(outcome.output, HasSubstr("paper_riged: no such file; looked for here and in " +
                                        prefix + "share/tachless/scenarios\n"));
}

TEST_F(Installed, ANewProjectDoesWhatItsReadmeSaysAsTyped) {
  EXPECT_EQ(type("tachless init arm").exit_code, 0);
  std::ifstream readme(directory_ / "arm/README.md");
  bool typed = false;
  int commands = 0;
  for (std::string line; std::getline(readme, line);) {
    if (line.starts_with("```")) {
      typed = line == "```sh";
    } else if (typed) {
      const Outcome outcome = type("cd arm && " + line);
      EXPECT_EQ(outcome.exit_code, 0) << line << "\n" << outcome.output;
      ++commands;
    }
  }
  EXPECT_GE(commands, 9);
  for (const char* file : {"out/arm/latest/report.html", "all.html", "arm.csv"}) {
    EXPECT_TRUE(fs::exists(directory_ / "arm" / file)) << file;
  }
}

// A line may name its expected exit code: "… # exit code 2".
TEST_F(Installed, TheTutorialWorksAsTyped) {
  std::ifstream tutorial(prefix + "share/doc/tachless/docs/tutorial.md");
  const std::string expects = " # exit code ";
  std::string folder = ".";
  bool typed = false;
  int commands = 0;
  for (std::string line; std::getline(tutorial, line);) {
    if (line.starts_with("```")) {
      typed = line == "```sh";
    } else if (typed && line.starts_with("cd ")) {
      folder = line.substr(3);
    } else if (typed) {
      const std::size_t at = line.find(expects);
      const int expected =
          at == std::string::npos ? 0 : std::stoi(line.substr(at + expects.size()));
      const Outcome outcome = type("cd " + folder + " && " + line);
      EXPECT_EQ(outcome.exit_code, expected) << line << "\n" << outcome.output;
      ++commands;
    }
  }
  EXPECT_GE(commands, 14);
  EXPECT_THAT(contents(directory_ / "my_arm/out/python/report.html"),
              HasSubstr("MyLaw (external)"));
  EXPECT_THAT(contents(directory_ / "my_arm/both.html"), HasSubstr("THREE"));
}

TEST_F(Installed, ANewProjectTakesNoDirectoryThatHasFiles) {
  EXPECT_EQ(type("mkdir old new && echo mine > old/arm.yaml").exit_code, 0);
  const Outcome outcome = type("tachless init old");
  EXPECT_EQ(outcome.exit_code, 2);
  EXPECT_THAT(outcome.output, HasSubstr("init old: is not empty; name another directory\n"));
  EXPECT_EQ(type("ls old").output, "arm.yaml\n");
  EXPECT_EQ(type("tachless init new").exit_code, 0);
  EXPECT_EQ(type("tachless init old/arm.yaml").exit_code, 2);
  EXPECT_EQ(type("tachless init old/arm.yaml/x").exit_code, 2);
}

// examples/own_law is equation (4) with the filter by backward Euler, which the tree has too.
TEST_F(Installed, OwnLawOfTheExampleGivesTheTorquesOfTheOneBuiltIn) {
  const std::string example = prefix + "work/own_law/";
  const std::string program = " --controller " + example + "build/own_law";
  const Outcome own = type("tachless run --out own " + example + "own_law.yaml" + program);
  ASSERT_EQ(own.exit_code, 0) << own.output;
  std::string scenario = contents(example + "own_law.yaml");
  const std::string external = "law: external\n  measurement: POSITION\n";
  ASSERT_THAT(scenario, HasSubstr(external));
  scenario.replace(scenario.find(external), external.size(),
                   "law: loria_ortega_rigid\n  filter: backward_euler\n");
  std::ofstream(example + "built_in.yaml") << scenario;  // beside its robot
  const Outcome built_in = type("tachless run --out built_in " + example + "built_in.yaml");
  ASSERT_EQ(built_in.exit_code, 0) << built_in.output;
  const auto expected = torques("built_in/lcmlog");
  const auto got = torques("own/lcmlog");
  ASSERT_EQ(expected.size(), 2000U);
  ASSERT_EQ(got.size(), expected.size());
  for (std::size_t k = 0; k < got.size(); ++k) {
    // The example writes the filter otherwise, so rounding differs. Gains of 40000 N m/rad and
    // 1000 N m s/rad make 1e-10 N m of an eps of e and nu.
    ASSERT_NEAR((got[k] - expected[k]).norm(), 0, 1e-8) << "tick " << k;
  }
  const Outcome replay = type("tachless replay own" + program);
  EXPECT_EQ(replay.exit_code, 0) << replay.output;
}

}  // namespace
}  // namespace tachless::installed_test
