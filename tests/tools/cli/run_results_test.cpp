#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <utility>

#include "base/json_text.h"
#include "cli/run.h"
#include "in_process/in_process_loop.h"
#include "tests/support/damaged_log.h"
#include "tests/support/in_process_log.h"
#include "tests/support/temporary_directory.h"

namespace tachless::cli {
namespace {

PlannedRun short_run(const std::string& scenario, const TemporaryDirectory& directory) {
  PlannedRun run{{}, support::shortened(scenario, "0.1")};
  run.options.out = directory / "out";
  run.options.run_id = 7;
  run.options.quiet = true;
  return run;
}

void write_log(const PlannedRun& run, const RunDirectory& out) {
  logger::write_file(out / "lcmlog", logger::log_of(support::in_process_log(run.scenario)));
}

// A robot that is brought to rest is recorded tick by tick, perhaps up to the run's last.
TEST(Conclusions, OfARunWithAllTicksWhoseRobotWasStoppedAreThatItWasStopped) {
  const TemporaryDirectory directory;
  const PlannedRun run = short_run("practical_rigid.yaml", directory);
  RunDirectory out(run);
  write_log(run, out);
  RunEnd end;
  end.code = base::ExitCode::protective_stop;
  end.facts.fault = "plant: protective stop at tick 90";
  Conclusions conclusions;
  conclusions.add(run, out, std::move(end));
  EXPECT_EQ(conclusions.finish(), base::ExitCode::protective_stop);
  const auto summary = base::parse_json(logger::read_file(out / "summary.json"));
  EXPECT_EQ(summary["ticks"], 100);
  EXPECT_EQ(summary["outcome"], "stopped");
}

TEST(Conclusions, OfAnAdaptiveLawHaveItsEstimates) {
  const TemporaryDirectory directory;
  const PlannedRun run = short_run("practical_adaptive.yaml", directory);
  RunDirectory out(run);
  write_log(run, out);
  Conclusions conclusions;
  conclusions.add(run, out, {});
  EXPECT_EQ(conclusions.finish(), base::ExitCode::done);
  double mass = 0;
  in_process::run_in_process(run.scenario, [&](const in_process::TickRecord& record) {
    mass = record.controller.value[3][0];
    return true;
  });
  EXPECT_GT(mass, 0);
  const auto summary = base::parse_json(logger::read_file(out / "summary.json"));
  EXPECT_EQ(summary["signals"]["mass"]["unit"], "kg");
  EXPECT_EQ(summary["signals"]["mass"]["last"], nlohmann::json({mass, mass}));
}

}  // namespace
}  // namespace tachless::cli
