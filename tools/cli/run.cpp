#include "cli/run.h"

#include <unistd.h>

#include <chrono>
#include <cmath>
#include <deque>
#include <utility>

#include "base/logging.h"
#include "base/this_process.h"
#include "in_process/in_process_log.h"
#include "logger/log_file.h"
#include "messages/wire.h"

namespace tachless::cli {
namespace {

using base::ExitCode;
using base::Failure;
using Clock = std::chrono::steady_clock;

/// Runs to the end, a fault or an interruption by the user.
RunEnd log_in_this_process(const PlannedRun& run, RunDirectory& out, Screen& screen) {
  constexpr std::int64_t looks = 64;  // ticks from one look at clock and user to the next
  const std::atomic<bool>& interrupted = base::catch_interruptions();
  const auto joints = static_cast<std::size_t>(run.scenario.num_joints);
  Progress progress = run.progress();
  session::Statistics statistics;  // what a plant process counts
  session::PlantStatistics& plant = statistics.plant();
  statistics.run_id = run.options.run_id;
  plant.saturated_ticks.assign(joints, 0);
  plant.beyond_limit_ticks.assign(joints, 0);
  const Clock::time_point begun = Clock::now();
  RunEnd end;
  logger::LogWriter log(out / "lcmlog");
  try {
    in_process::log_in_process(
        run.scenario, make_law(run.options.law_program)(run.scenario), run.options.run_id,
        [&](const in_process::LogMessage& message) {
          log.append(message.utime, message.channel, message.data);
        },
        [&](const in_process::TickRecord& record) {
          statistics.ticks = record.tick + 1;
          for (std::size_t i = 0; i < joints; ++i) {
            plant.saturated_ticks[i] += record.applied.saturated[i] ? 1 : 0;
            plant.beyond_limit_ticks[i] += record.beyond_limit[i] ? 1 : 0;
          }
          if (record.tick % looks != 0) return true;
          const double error = (record.truth.q - record.reference.q_ref).norm();
          progress.note(record.tick, error, Clock::now());
          screen.show({&progress, 1});
          out.look();
          return !interrupted;
        });
    log.close();
    if (interrupted) {
      end.code = ExitCode::interrupted;
      end.facts.fault = "interrupted";
    }
  } catch (const Failure& failure) {
    end.code = failure.code();
    end.facts.fault = failure.what();
  }
  end.facts.placement = "one process";
  end.facts.wall_s = std::chrono::duration<double>(Clock::now() - begun).count();
  statistics.exit_code = end.code;
  statistics.fault = end.facts.fault;
  statistics.wall_s = end.facts.wall_s;
  end.statistics.push_back(std::move(statistics));
  return end;
}

ExitCode in_this_process(const std::vector<PlannedRun>& runs) {
  base::survive_broken_pipes();
  std::deque<RunDirectory> out;
  for (const PlannedRun& run : runs) out.emplace_back(run);
  Screen screen(runs.front().options.quiet);
  for (const PlannedRun& run : runs) run.print_remarks();
  Conclusions conclusions;
  std::string failed;
  for (std::size_t i = 0; i < runs.size(); ++i) {
    const RunOptions& options = runs[i].options;
    if (!failed.empty()) {
      base::log_error(options.named("not begun, because " + failed + " did not end well"));
      continue;
    }
    RunEnd end = log_in_this_process(runs[i], out[i], screen);
    screen.clear();
    if (end.code != ExitCode::done) failed = options.robot;
    conclusions.add(runs[i], out[i], std::move(end));
  }
  return conclusions.finish();
}

}  // namespace

ExitCode run(const RunOptions& options, const std::vector<std::filesystem::path>& scenarios) {
  const std::vector<PlannedRun> runs = plan_runs(options, scenarios);
  if (options.in_process) return in_this_process(runs);
  for (const PlannedRun& each : runs) {
    if (!options.ramp) break;
    const ExitCode code = ramp(options, each);
    if (code != ExitCode::done) return code;
  }
  return run_on_bus(runs);
}

}  // namespace tachless::cli
