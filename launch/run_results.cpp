#include "launch/run_results.h"

#include <fmt/core.h>

#include <filesystem>
#include <future>
#include <iostream>
#include <string_view>

#include "certificate/stability_certificate.h"
#include "diagnostics/failure.h"
#include "diagnostics/json_text.h"
#include "diagnostics/logging.h"
#include "diagnostics/text.h"
#include "diagnostics/unfinished_file.h"
#include "logger/run_log.h"
#include "report/gnuplot.h"
#include "report/recorded_run.h"
#include "report/report.h"
#include "report/report_sections.h"
#include "robot/joint_labels.h"

namespace tachless::launch {
namespace {

/// The log of a run, read back.
struct ReadBack {
  explicit ReadBack(int num_joints) : tracking(num_joints) {}

  study::Tracking tracking;
  std::int64_t ticks = 0;
  std::int64_t gaps = 0;
  bool damaged = false;
  std::string law;      ///< as the log names it
  std::string problem;  ///< why it cannot be read; empty: it can
};

ReadBack read_back(const experiment::Scenario& scenario, const std::string& path,
                   std::int64_t run) {
  ReadBack result(scenario.num_joints);
  try {
    logger::RunLog log = logger::RunLog::open(path, run);
    result.tracking = report::track(log);
    result.ticks = static_cast<std::int64_t>(log.summary().ticks);
    result.gaps = static_cast<std::int64_t>(log.summary().gaps());
    result.damaged = log.damage().any();
    result.law = log.scenario().controller.law_text();
  } catch (const diagnostics::Failure& failure) {
    result.problem = failure.what();
  }
  return result;
}

/// What is wrong with the log of a run of which every program says that it ended well; empty:
/// nothing. In realtime ticks may be missing, which the logger then has said.
std::string log_problem(const ReadBack& log, const experiment::Scenario& scenario,
                        const std::string& path) {
  if (!log.problem.empty()) return log.problem;
  const bool lockstep = scenario.loop.mode == experiment::Mode::lockstep;
  const std::int64_t expected = scenario.loop.num_ticks;
  if (!log.damaged && (!lockstep || (log.ticks == expected && log.gaps == 0))) return {};
  return fmt::format(
      "{}: the log was changed after it was written: it has {} of {} ticks and {} gaps{}; run "
      "again, and leave it alone until the run has ended",
      path, log.ticks, expected, log.gaps, log.damaged ? ", and is damaged" : "");
}

/// The table, and the files.
void show(const report::RunSummary& summary, const std::string& title,
          const robot::JointLabels& joints, const RunDirectory& out) {
  std::cout << fmt::format("\n{}\n\n{}\n", title, closing_table(summary, joints));
  for (const std::filesystem::path& file : out.files()) {
    std::cout << fmt::format("  {}\n", diagnostics::printable(file.string()));
  }
}

report::RunFacts facts_of(const experiment::Scenario& scenario, const RunOptions& options,
                          const RunEnd& end) {
  report::RunFacts facts;
  facts.scenario = scenario.name;
  facts.run_id = options.run_id;
  facts.mode = scenario.loop.mode == experiment::Mode::lockstep ? "lockstep" : "realtime";
  facts.law = scenario.controller.law;
  facts.period_s = scenario.loop.period_s;
  facts.planned_ticks = scenario.loop.num_ticks;
  facts.wall_s = end.wall_s;
  facts.placement = end.placement;
  facts.fault = end.fault;
  return facts;
}

/// Tells what cannot be written, and returns its exit code.
diagnostics::ExitCode write_results(const experiment::Scenario& scenario, const RunOptions& options,
                                    const RunDirectory& out, const report::RunSummary& summary,
                                    const robot::JointLabels& joints) {
  const study::Tracking& tracking = summary.tracking;
  const report::RunFacts& facts = summary.facts;
  const std::string json = diagnostics::json_text(to_json(summary, joints), 2) + "\n";
  const std::string title =
      fmt::format("{}: {}, h = {}", scenario.name, facts.law, report::short_period(facts.period_s));
  const std::string_view remedy = "name another directory with --out";
  auto code = diagnostics::ExitCode::done;
  try {
    if (out.begun()) diagnostics::UnfinishedFile(out / "summary.json", remedy).write(json);
    if (tracking.num_ticks() > 0) {
      // Each waits for a gnuplot of its own.
      auto reported = std::async(std::launch::async, [&] {
        report::write_report(
            {report::read_recorded_run(facts.log_path, facts.run_id, certificate::certified_run)},
            out / "report.html");
      });
      report::draw_file(report::tracking_figure(tracking, title, facts.period_s, joints),
                        out / "tracking.svg", remedy);
      reported.get();
    }
  } catch (const diagnostics::Failure& failure) {
    diagnostics::log_error(failure.what());
    code = failure.code();
  }
  if (options.json) {
    std::cout << json;
  } else if (!options.quiet && tracking.num_ticks() > 0) {
    show(summary, options.named(title), joints, out);
  }
  return code;
}

}  // namespace

Concluded conclude(const experiment::Scenario& scenario, const RunOptions& options,
                   RunDirectory& out, const RunEnd& end, const std::function<void()>& tell_others) {
  out.look();
  report::RunFacts facts = facts_of(scenario, options, end);
  facts.log_path = (out / "lcmlog").string();
  const ReadBack log = read_back(scenario, facts.log_path, options.run_id);
  facts.log_ticks = log.ticks;
  if (!log.law.empty()) facts.law = log.law;
  facts.log_gaps = log.gaps;
  diagnostics::ExitCode code = end.code;
  const bool done = code == diagnostics::ExitCode::done;
  if (done) {
    const std::string problem = log_problem(log, scenario, facts.log_path);
    if (!problem.empty()) {
      facts.fault = problem;
      code = diagnostics::ExitCode::check_said_no;
    }
  }
  if (facts.fault) {
    diagnostics::log_error(options.named(*facts.fault));
    tell_others();
  }
  const report::RunSummary summary{facts, log.tracking, end.statistics};
  const robot::JointLabels joints = robot::joint_labels(*scenario.model);
  const auto written = write_results(scenario, options, out, summary, joints);
  if (code == diagnostics::ExitCode::done) code = written;
  if (done && !options.any_verdict && summary.observed.bad()) {
    diagnostics::log_error(options.named(
        fmt::format("{}; --any-verdict makes that no failure", text(summary.observed, joints))));
    code = diagnostics::ExitCode::check_said_no;
  }
  return {code, overview_row(options.robot, summary, joints)};
}

}  // namespace tachless::launch
