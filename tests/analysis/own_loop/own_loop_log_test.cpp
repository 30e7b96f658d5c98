// The law in a loop of one's own commands the torques that the controller's process recorded.
#include <gtest/gtest.h>

#include <ostream>
#include <string>
#include <vector>

#include "logger/run_log.h"
#include "own_loop/own_loop.h"
#include "tests/support/damaged_log.h"
#include "tests/support/in_process_log.h"
#include "tests/support/temporary_directory.h"

namespace tachless::own_loop {
namespace {

struct Recording {
  std::string file;
  std::vector<std::string> set;
};

void PrintTo(const Recording& recording, std::ostream* out) { *out << recording.file; }

class OwnLoopLog : public testing::TestWithParam<Recording> {
 protected:
  /// Returns the ticks of a lockstep run.
  std::vector<logger::TickRecord> recorded() {
    const auto path = directory_.path() / "lcmlog";
    logger::write_file(
        path,
        logger::log_of(support::in_process_log(scenario::load_scenario(file(), GetParam().set))));
    logger::RunLog log = logger::RunLog::open(path);
    std::vector<logger::TickRecord> ticks;
    logger::TickRecord record;
    while (log.next(record)) ticks.push_back(record);
    return ticks;
  }
  static std::string file() {
    return std::string(TACHLESS_SOURCE_DIR "/scenarios/") + GetParam().file;
  }

  TemporaryDirectory directory_;
};

TEST_P(OwnLoopLog, HasTheTorquesOfTheLoopBitForBit) {
  Loop loop(file(), GetParam().set);
  const std::vector<logger::TickRecord> ticks = recorded();
  ASSERT_GT(ticks.size(), 90U);
  for (const logger::TickRecord& each : ticks) {
    const Vector& q = std::get<messages::PositionMeasurement>(each.measurement.value()).q;
    const Step step = loop.torque(each.tick, q);
    ASSERT_TRUE(step.ok()) << loop.reason(step);
    const Vector& recorded = each.command.value().tau;
    ASSERT_EQ(std::vector<double>(step.law_tau.begin(), step.law_tau.end()),
              std::vector<double>(recorded.begin(), recorded.end()))
        << "tick " << each.tick;
  }
}

TEST_P(OwnLoopLog, HasTheSameTorquesWithTheRecordedReferenceAsTheCallers) {
  Loop loop(file(), GetParam().set);
  for (const logger::TickRecord& each : recorded()) {
    const Vector& q = std::get<messages::PositionMeasurement>(each.measurement.value()).q;
    const messages::ReferencePoint& r = each.reference.value();
    const Step step =
        loop.torque(each.tick, q, {r.q_ref, r.v_ref, r.a_ref, r.jerk_ref, r.snap_ref});
    const Vector& recorded = each.command.value().tau;
    ASSERT_EQ(std::vector<double>(step.law_tau.begin(), step.law_tau.end()),
              std::vector<double>(recorded.begin(), recorded.end()))
        << "tick " << each.tick;
  }
}

INSTANTIATE_TEST_SUITE_P(
    Scenarios, OwnLoopLog,
    testing::Values(Recording{"practical_rigid.yaml", {"loop.duration_s=0.3"}},
                    Recording{"iiwa_point_to_point.yaml", {"loop.duration_s=0.3"}},
                    Recording{"ur5e.yaml", {"loop.duration_s=0.4"}},
                    Recording{"practical_rigid.yaml",
                              {"loop.duration_s=0.1", "robot.compensates.gravity=true",
                               "controller.friction={viscous: 0.1, coulomb: 0.2}"}},
                    Recording{"practical_rigid.yaml",
                              {"loop.duration_s=0.1", "controller.law=loria_ortega_matrix",
                               "controller.gains={kp: [[40000, 2000], [2000, 2400]], kd: [[1000, "
                               "50], [50, 60]], a: 1000, b: 1000}"}}));

}  // namespace
}  // namespace tachless::own_loop
