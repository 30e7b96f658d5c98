#include "scenario/motion_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <string>
#include <utility>

#include "reference/make_trajectory.h"
#include "tests/support/temporary_directory.h"

namespace tachless::scenario {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

/// Two joints that may go from -1 to 2 at 10 rad/s.
constexpr const char* urdf = R"(<robot name="two"><link name="ground"/>
<link name="a"><inertial><origin xyz="0 0 -1"/><mass value="1"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="b"><inertial><origin xyz="0 0 -1"/><mass value="1"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shoulder" type="revolute"><parent link="ground"/><child link="a"/><axis xyz="0 1 0"/>
  <limit lower="-1" upper="2" effort="10" velocity="10"/></joint>
<joint name="elbow" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/>
  <limit lower="-1" upper="2" effort="10" velocity="10"/></joint></robot>)";

reference::trajectory::WaypointSpline parsed(const std::string& table) {
  return parse_motion(table, "m.csv", robot::model_from_urdf(urdf, "two.urdf"));
}

/// At the row before the last the spline is a sum of eight rounded coefficients of size one to ten.
constexpr double rounding = 1e-14;

double apart(const Vector& q, const Eigen::Vector2d& expected) {
  return (q - expected).lpNorm<Eigen::Infinity>();
}

std::string refusal(const std::string& table) {
  try {
    parsed(table);
  } catch (const std::invalid_argument& refused) {
    return refused.what();
  }
  return "accepted";
}

TEST(MotionFile, FindsItsColumnsByNameOrByOrder) {
  const auto by_name = parsed(
      "# made elsewhere\n\nelbow, force, time, shoulder\n0.2, 9, 0, 0.1\n0.4, 9, 1, 0.3 # a note\n"
      "0.6;9;2;0.5\r\n");
  const auto by_order = parsed("0 0.1 0.2\n1\t0.3\t0.4\n2, 0.5, 0.6");
  for (const double t : {0.0, 0.4, 1.0, 1.7, 2.0, 3.0}) {
    EXPECT_EQ(by_name.at(t).q_ref, by_order.at(t).q_ref) << t;
    EXPECT_EQ(by_name.at(t).snap_ref, by_order.at(t).snap_ref) << t;
  }
  EXPECT_LE(apart(by_name.at(1).q_ref, {0.3, 0.4}), rounding);
}

TEST(MotionFile, NamesTheLineOfWhatIsWrong) {
  const std::pair<std::string, std::string> cases[] = {
      {"0 0 0\n1 0 0\n\n1 0 0\n", "m.csv:4: time 1 s is not after 1 s; allowed: increasing times"},
      {"0 0 0\n1 0\n", "m.csv:2: 2 columns; allowed: 3, the time and a position for each joint"},
      {"time,shoulder,elbow,more\n0,0,0\n", "m.csv:2: 3 columns; allowed: 4"},
      {"0 0 0\n1 0 x\n", "m.csv:2: \"x\" is not a finite number"},
      {"0 0 0\n1 0 nan\n", "m.csv:2: \"nan\" is not a finite number"},
      {"0 0 0\n1 0 1e999\n", "m.csv:2: \"1e999\" is not a finite number"},
      {"time,elbow\n0,0\n",
       "m.csv:1: no column \"shoulder\", which is a joint; there are time, elbow"},
      {"when,elbow,shoulder\n", "m.csv:1: no column for the time (time, time_s, t_s)"},
      {"t_s,elbow,shoulder,elbow\n", "m.csv:1: two columns \"elbow\""},
      {"# none\n0 0 0\n", "m.csv:2: 1 rows; allowed: at least 2"},
      {"0 0 0\n1 0 2.5\n", "m.csv:2: joint 2 (elbow) is at 2.5; allowed by the URDF: -1 to 2"},
      {"0 0 0\n0.01 0.2 0\n",
       "m.csv:2: joint 1 (shoulder) moves at 20 per second since the row before; allowed by the "
       "URDF: 10"}};
  for (const auto& [table, message] : cases) EXPECT_THAT(refusal(table), StartsWith(message));
}

class ScenarioWithATable : public ::testing::Test {
 protected:
  void SetUp() override {
    write("two.urdf", urdf);
    write("m.csv", "0 0 0\n1 0.5 0.5\n2 0 0\n");
    write("a.yaml",
          "name: a\nrobot: {urdf: two.urdf}\ncontroller: {law: some_law, gains: {}}\n"
          "loop: {duration_s: 2}\nreference: {file: m.csv}\n");
  }
  void write(const std::string& name, const std::string& text) {
    std::ofstream(directory_ / name, std::ios::binary) << text;
  }
  Scenario load(const std::vector<std::string>& overrides = {}) {
    return load_scenario(directory_ / "a.yaml", overrides);
  }
  std::string refusal_with(const std::vector<std::string>& overrides) {
    try {
      (void)load(overrides);
    } catch (const base::Failure& failure) {
      EXPECT_EQ(failure.code(), base::ExitCode::bad_usage);
      return failure.what();
    }
    return "accepted";
  }

  TemporaryDirectory directory_;
};

TEST_F(ScenarioWithATable, FollowsIt) {
  const auto trajectory = reference::make_trajectory(load());
  EXPECT_LE(apart(trajectory.at(1).q_ref, {0.5, 0.5}), rounding);
  EXPECT_EQ(trajectory.at(5).q_ref, Eigen::Vector2d(0, 0));
}

/// A log and a message carry the scenario's text and not the table.
TEST_F(ScenarioWithATable, IsTheSameFromItsTextButForTheMotion) {
  const Scenario scenario = load();
  const Scenario again = parse_scenario(scenario.text, scenario.robot.urdf_text, "log");
  EXPECT_EQ(again.digest, scenario.digest);
  EXPECT_EQ(again.text, scenario.text);
  EXPECT_THROW(reference::make_trajectory(again), base::Failure);

  Scenario read = again;
  read_motion(read, directory_.path());
  EXPECT_EQ(reference::make_trajectory(read).at(0.3).q_ref,
            reference::make_trajectory(scenario).at(0.3).q_ref);
}

TEST_F(ScenarioWithATable, IsAnotherScenarioWithAnotherTable) {
  const Scenario before = load();
  write("m.csv", "0 0 0\n1 0.5 0.5\n2 0.1 0\n");
  EXPECT_NE(load().digest, before.digest);
  const std::string pinned = std::get<reference::trajectory::MotionFile>(before.reference).digest;
  EXPECT_THAT(refusal_with({"reference={file: {path: m.csv, digest: '" + pinned + "'}}"}),
              HasSubstr("reference.file.digest: " + pinned + ", but that of"));
  Scenario from_text = parse_scenario(before.text, before.robot.urdf_text, "log");
  EXPECT_THROW(read_motion(from_text, directory_.path()), base::Failure);
}

TEST_F(ScenarioWithATable, NamesAFileThatIsNotThere) {
  EXPECT_THAT(refusal_with({"reference.file=none.csv"}), HasSubstr("none.csv: no such file"));
  EXPECT_THAT(refusal_with({"reference.file.path=[1]"}), HasSubstr("reference.file.path"));
}

}  // namespace
}  // namespace tachless::scenario
