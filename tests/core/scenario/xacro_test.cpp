// Robots from files for xacro, with a program of that name in its place.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <sstream>

#include "scenario/scenario.h"
#include "tests/support/temporary_directory.h"

namespace tachless::scenario {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

class Xacro : public ::testing::Test {
 protected:
  Xacro() {
    std::stringstream urdf;
    urdf << std::ifstream(TACHLESS_SOURCE_DIR "/scenarios/robots/two_link.urdf").rdbuf();
    std::string text = urdf.str();
    text.replace(text.find("two_link"), 8, "$(arg name)");
    text.insert(text.rfind("</robot>"), R"(<xacro:arg name="name"/><xacro:arg name="more" />)");
    std::ofstream(directory_ / "arm.urdf.xacro") << text;
    old_path_ = std::getenv("PATH");
  }
  ~Xacro() override { setenv("PATH", old_path_.c_str(), 1); }

  /// A program `xacro` that is this shell script, alone on the search path but for the system's.
  void install(const std::string& script) {
    fs::create_directory(directory_ / "bin");
    const fs::path program = directory_ / "bin/xacro";
    std::ofstream(program) << "#!/bin/sh\n" << script << "\n";
    fs::permissions(program, fs::perms::owner_all);
    setenv("PATH", ((directory_ / "bin").string() + ":/usr/bin:/bin").c_str(), 1);
  }
  [[nodiscard]] Scenario load(const std::vector<std::string>& more) const {
    std::vector<std::string> all = {"robot.urdf=" + (directory_ / "arm.urdf.xacro").string()};
    all.insert(all.end(), more.begin(), more.end());
    return load_scenario(TACHLESS_SOURCE_DIR "/scenarios/practical_rigid.yaml", all);
  }
  [[nodiscard]] std::string refusal(const std::vector<std::string>& more) const {
    try {
      static_cast<void>(load(more));
    } catch (const base::Failure& failure) {
      EXPECT_EQ(failure.code(), base::ExitCode::bad_usage);
      return failure.what();
    }
    return "";
  }

  TemporaryDirectory directory_;
  std::string old_path_;
};

/// FILE -o URDF name:=value…
constexpr const char* stand_in =
    "echo a warning >&2\nprintf '%s\\n' \"$@\" > \"$(dirname \"$1\")/words\"\n"
    "sed 's/$(arg name)/two_link/' \"$1\" > \"$3\"";

TEST_F(Xacro, MakesTheUrdfThatTheRecordedScenarioHas) {
  install(stand_in);
  const Scenario scenario = load({"robot.xacro={name: arm, more: '$(touch x); true'}"});
  EXPECT_EQ(scenario.num_joints, 2);
  std::stringstream words;
  words << std::ifstream(directory_ / "words").rdbuf();
  EXPECT_THAT(words.str(), HasSubstr("\nmore:=$(touch x); true\nname:=arm\n"))
      << "no shell has read them";
  setenv("PATH", "", 1);  // what is recorded needs no program
  const Scenario recorded = parse_scenario(scenario.text, scenario.robot.urdf_text, "a log");
  EXPECT_EQ(recorded.digest, scenario.digest);
  EXPECT_EQ(recorded.robot.xacro.at("name"), "arm");
}

TEST_F(Xacro, IsRunOnAFileWithoutAScenarioToo) {
  install(stand_in);
  const RobotFile file =
      robot_file(directory_ / "arm.urdf.xacro",
                 {"robot.xacro.name=arm", "robot.locked.elbow=0.5", "loop.period_s=0.1"});
  EXPECT_THAT(file.urdf, HasSubstr("<robot name=\"two_link\""));
  EXPECT_EQ(file.options.locked.at("elbow"), 0.5);
  std::stringstream words;
  words << std::ifstream(directory_ / "words").rdbuf();
  EXPECT_THAT(words.str(), HasSubstr("\nname:=arm\n"));
}

TEST_F(Xacro, SaysWhatIsMissingOrWrong) {
  setenv("PATH", directory_.path().c_str(), 1);
  EXPECT_THAT(refusal({}), HasSubstr("not on the PATH; type: pip install xacro"));
  install("echo 'Undefined substitution argument name' >&2\nexit 2");
  EXPECT_THAT(refusal({}), HasSubstr("arm.urdf.xacro: xacro ended with exit code 2: Undefined "
                                     "substitution argument name; give robot.xacro: {name: …}, or "
                                     "--set robot.xacro.name=…"));
  install("true");
  EXPECT_THAT(refusal({}), HasSubstr("arm.urdf.xacro: xacro ended"));
  install("head -c 2000000 /dev/zero > \"$3\"");  // more than a URDF may have
  EXPECT_NE(refusal({}), "");
  install(stand_in);
  EXPECT_THAT(refusal({"robot.xacro={-o: x}"}), HasSubstr("\"-o\" is no argument's name"));
  EXPECT_THAT(refusal({"robot.xacro={name: x}",
                       "robot.urdf=" TACHLESS_SOURCE_DIR "/scenarios/robots/two_link.urdf"}),
              HasSubstr("allowed: .xacro"));
  EXPECT_FALSE(fs::exists("x"));
}

/// The program passes over an argument that no file declares.
TEST_F(Xacro, RefusesAnArgumentThatNoFileDeclares) {
  std::ofstream(directory_ / "part.xacro") << R"(<r><xacro:arg default="1" name='inner'/></r>)";
  install(
      std::string("if [ \"$4\" = --deps ]; then echo \"$(dirname \"$1\")/part.xacro\" > \"$3\"; "
                  "exit; fi\n") +
      stand_in);
  EXPECT_THAT(
      refusal({"robot.xacro={naem: x}"}),
      HasSubstr("arm.urdf.xacro: robot.xacro: it has no <xacro:arg> \"naem\"; the nearest is "
                "name"));
  EXPECT_THAT(refusal({"robot.xacro={'name:': x}"}), HasSubstr("the nearest is name"));
  EXPECT_EQ(refusal({"robot.xacro={name: x, inner: 2}"}), "");
}

}  // namespace
}  // namespace tachless::scenario
