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

using ::testing::AllOf;
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

std::string refusal_of_table(const std::string& table) {
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
      "0.6,9,2,0.5\r\n");
  const auto by_order = parsed("0 0.1 0.2\n1\t0.3\t0.4\n2  0.5 0.6");
  for (const double t : {0.0, 0.4, 1.0, 1.7, 2.0, 3.0}) {
    EXPECT_EQ(by_name.at(t).q_ref, by_order.at(t).q_ref) << t;
    EXPECT_EQ(by_name.at(t).snap_ref, by_order.at(t).snap_ref) << t;
  }
  EXPECT_LE(apart(by_name.at(1).q_ref, {0.3, 0.4}), rounding);
}

TEST(MotionFile, NamesTheLineOfWhatIsWrong) {
  const std::pair<std::string, std::string> cases[] = {
      {"0 0 0\n1 0 0\n\n1 0 0\n", "m.csv:4: time 1 s is not after 1 s; allowed: increasing times"},
      {"0 0 0\n1 0\n", "m.csv:2: 2 columns; allowed: 3, as in the first row"},
      {"time,shoulder,elbow,more\n0,0,0\n", "m.csv:2: 3 columns; allowed: 4"},
      {"0 0\n1 0\n", "m.csv:1: 2 columns; allowed: 3, the time and a position for each joint"},
      {"0 0 0\n1 0 x\n", "m.csv:2: \"x\" in column 3 is not a finite number"},
      {"0 0 0\n1 0 nan\n", "m.csv:2: \"nan\" in column 3 is not a finite number"},
      {"0 0 0\n1 0 1e999\n", "m.csv:2: \"1e999\" in column 3 is not a finite number"},
      {"time,shoulder,elbow\n0,,0\n", "m.csv:2: column \"shoulder\" is empty"},
      {"time,shoulder,elbow\n0,0,\n", "m.csv:2: column \"elbow\" is empty"},
      {"0,0,0\n1,,0\n", "m.csv:2: column 2 is empty"},
      {"0,0,0\n1 0,0\n", "m.csv:2: 2 columns; allowed: 3"},
      {"time,shoulder,elbow\n\"0,0,0\n", "m.csv:2: a quotation mark is not closed"},
      {"time,shoulder,elbow\n\"0\"1,0,0\n", "m.csv:2: text behind the quoted field \"0\""},
      {"time [ms],shoulder,elbow\n0,0,0\n",
       "m.csv:1: \"time [ms]\" is not in seconds; give time_scale"},
      {"t,time,shoulder,elbow\n0,0,0,0\n", "m.csv:1: both \"t\" and \"time\" may be the time"},
      {"time;shoulder;elbow\n0;0,1;0,2\n", "m.csv:2: \"0,1\" in column \"shoulder\""},
      {"", "m.csv:1: no rows"},
      {"time,elbow\n0,0\n", "m.csv:1: no column \"shoulder\"; there are time, elbow"},
      {"when,elbow,shoulder\n", "m.csv:1: no column for the time (time, time_s, t_s, t, timestamp"},
      {"joint_names: [shoulder, elbow]\npoints:\n", "m.csv:1: no column for the time"},
      {"t_s,elbow,shoulder,elbow\n", "m.csv:1: two columns \"elbow\""},
      {"# none\n0 0 0\n", "m.csv:2: 1 rows; allowed: at least 2"},
      {"0 0 0\n1 0 2.5\n", "m.csv:2: joint 2 (elbow) is at 2.5; allowed by the URDF: -1 to 2"},
      {"0 0 0\n0.01 0.2 0\n",
       "m.csv:2: joint 1 (shoulder) moves at 20 per second since the row before; allowed by the "
       "URDF: 10"}};
  for (const auto& [table, message] : cases)
    EXPECT_THAT(refusal_of_table(table), StartsWith(message));
}

/// The forms in which other programs write the same table.
TEST(MotionFile, ReadsTheTablesOfOtherPrograms) {
  const auto expected = parsed("0 0 0\n1 0.1 0.2\n2 0 0\n");
  const std::pair<const char*, std::string> cases[] = {
      {"an empty column and a blank in another",
       "time,gap,shoulder,elbow,pair\n0,,0,0,0 0\n1,,0.1,0.2,0.3 0.4\n2,,0,0,0 0\n"},
      {"byte order mark", "\xef\xbb\xbftime,shoulder,elbow\n0,0,0\n1,0.1,0.2\n2,0,0\n"},
      {"quotes", "\"time\",\"shoulder\",\"elbow\"\n0,0,0\n1,\"0.1\",0.2\n2,0,0\n"},
      {"unit", "Time [s],shoulder,elbow\n0,0,0\n1,0.1,0.2\n2,0,0\n"},
      {"text", "t,shoulder,elbow,mode\n0,0,0,idle\n1,0.1,0.2,moving fast\n2,0,0,\"a,\nb\"\n"},
      {"semicolons", "timestamp;elbow;shoulder\r\n0;0;0\r\n1;+0.2;0.1\r\n2;0;0\r\n"},
      {"tabs", "__time\tshoulder\telbow\n0\t0\t0\n1\t0.1\t0.2\n2\t0\t0\n"},
      {"separator behind", "time_from_start,shoulder,elbow,\n0,0,0,\n1,0.1,0.2,\n2,0,0,\n"},
      {"names in a comment",
       "% made by a logger\n# time elbow shoulder\n0 0 0\n1 0.2 0.1\n2 0 0\n"},
  };
  for (const auto& [name, table] : cases) {
    EXPECT_EQ(refusal_of_table(table), "accepted") << name;
    if (refusal_of_table(table) != "accepted") continue;
    const auto found = parsed(table);
    for (const double t : {0.3, 1.0, 1.6})
      EXPECT_EQ(found.at(t).q_ref, expected.at(t).q_ref) << name;
  }
}

/// One separator, quote, blank or row end in another place gives the same motion or a refusal.
TEST(MotionFile, IsNeverAnotherMotionForOneWrongCharacter) {
  const std::string marks = ",; \t\"#%\n\r";
  for (const std::string table :
       {"time,shoulder,elbow\n0,0,0\n1,0.1,0.2\n2,0.3,0.4\n", "0 0 0\n1 0.1 0.2\n2 0.3 0.4\n"}) {
    const auto expected = parsed(table);
    for (std::size_t at = 0; at < table.size(); ++at) {
      if (marks.find(table[at]) == std::string::npos) continue;
      for (const char mark : marks + 'x') {
        std::string wrong = table;
        if (mark == 'x') {
          wrong.erase(at, 1);
        } else {
          wrong[at] = mark;
        }
        // A comment mark in place of a row's end makes the table shorter, as it says.
        if (refusal_of_table(wrong) != "accepted" || mark == '#') continue;
        const auto found = parsed(wrong);
        for (const double t : {0.0, 0.5, 1.0, 1.7}) {
          EXPECT_EQ(found.at(t).q_ref, expected.at(t).q_ref) << wrong;
        }
      }
    }
  }
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

TEST_F(ScenarioWithATable, SaysThatItsTimesDoNotFitTheRun) {
  EXPECT_TRUE(load().model->warnings.empty());
  write("m.csv", "261.6 0 0\n262.6 0.5 0.5\n263.6 0 0\n");
  EXPECT_THAT(refusal_with({}),
              AllOf(HasSubstr("its times go from 261.6 to 263.6 s and the run from "
                              "0 to 2 s: nothing would move"),
                    HasSubstr("time_offset: -261.6")));
  const Scenario moved = load({"reference={file: {path: m.csv, time_offset: -261.6}}"});
  EXPECT_LE(apart(reference::make_trajectory(moved).at(1).q_ref, {0.5, 0.5}), 1e-10);
  write("m.csv", "0 0 0\n1000 0.5 0.5\n2000 0 0\n");
  ASSERT_EQ(load().model->warnings.size(), 1U);
  EXPECT_THAT(load().model->warnings[0],
              HasSubstr("only a part of the motion: it ends at 2000 s, after the run (2 s)"));
  const Scenario scaled = load({"reference={file: {path: m.csv, time_scale: 0.001}}"});
  EXPECT_TRUE(scaled.model->warnings.empty());
  EXPECT_LE(apart(reference::make_trajectory(scaled).at(1).q_ref, {0.5, 0.5}), rounding);
}

TEST_F(ScenarioWithATable, NamesAFileThatIsNotThere) {
  EXPECT_THAT(refusal_with({"reference.file=none.csv"}), HasSubstr("none.csv: no such file"));
  EXPECT_THAT(refusal_with({"reference.file.path=[1]"}), HasSubstr("reference.file.path"));
}

}  // namespace
}  // namespace tachless::scenario
