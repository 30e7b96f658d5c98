// The report in a real browser: no console message, every chart with a size, no sideways scrolling
// on a phone; on paper nothing cut off and no heading parted from what it heads.

#include "tests/report/browser.h"

namespace tachless::report {
namespace {

TEST_F(Browser, TellsOfWhatAPageWritesToTheConsole) {
  const fs::path page = profile_.path() / "page.html";
  std::ofstream(page) << "<!DOCTYPE html><script>console.error('broken')</script>";
  EXPECT_THAT(open(page, {"--dump-dom"}).console, HasSubstr("broken"));
}

TEST_F(Browser, ShowsTheReportOfOneRun) {
  std::vector<RecordedRun> runs;
  runs.push_back(recorded("one", support::shortened("practical_rigid.yaml", "1",
                                                    {"plant.drive.torque_limit_Nm=[500, 60]"})));
  // Two joints' tracking, error, torque, controller signals; V; round trip; saturation.
  look_at("one_run", runs, 11);
  print("one_run", 11, 5);
}

TEST_F(Browser, ShowsTheReportOfAFlexibleRobot) {
  std::vector<RecordedRun> runs;
  runs.push_back(recorded("one", support::shortened("practical_flexible.yaml", "1")));
  look_at("flexible", runs, 10);
  print("flexible", 10, 5);
}

TEST_F(Browser, ShowsTheReportOfSeveralRuns) {
  std::vector<RecordedRun> runs;
  runs.push_back(recorded("no_lead", support::shortened("practical_rigid.yaml", "1",
                                                        {"controller.feedforward_lead=none"})));
  runs.push_back(recorded("with_lead", support::shortened("practical_rigid.yaml", "1")));
  runs.push_back(recorded(
      "payload", support::shortened("practical_rigid.yaml", "1", {"plant.payload.mass_kg=0.5"})));
  label(runs);
  look_at("several_runs", runs, 10);
  print("several_runs", 10, 6);
}

TEST_F(Browser, ShowsTheReportOfSevenJoints) {
  std::vector<RecordedRun> runs;
  runs.push_back(recorded("iiwa", support::shortened("iiwa_point_to_point.yaml", "1.5")));
  look_at("seven_joints", runs, 4 * 7 + 2);
  print("seven_joints", 4 * 7 + 2, 9);
}

}  // namespace
}  // namespace tachless::report
