// The verb that looks at an arm before its first run: commission.

#include "commission/commission.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "base/file_text.h"
#include "base/json_text.h"
#include "base/logging.h"
#include "cli/progress.h"
#include "cli/run.h"
#include "cli/verb.h"
#include "commission/emulated_arm.h"
#include "commission/trials.h"
#include "identify/recording.h"
#include "session/options.h"

namespace tachless::cli {
namespace {

namespace fs = std::filesystem;
using base::ExitCode;

/// Longest time without a reading, or two ticks: the motion in it is not known.
constexpr double longest_gap_s = 5e-3;

/// Returns what a run on the bus recorded, up to its end or the protective stop. Returns nothing if
/// too many ticks are missing, in a row or in all. A drive on a CAN bus answers the first command a
/// tick late.
std::optional<commission::Trial> read_trial(const fs::path& log, double period_s) {
  logger::RunLog run = logger::RunLog::open(log);
  const identify::Ticks ticks = identify::read_ticks(run, true);
  identify::FilledTicks filled = identify::fill(ticks);
  const double longest = std::max(2.0, longest_gap_s / period_s);
  if (static_cast<double>(filled.longest) > longest * (1 + 1e-9) ||
      static_cast<double>(filled.missing) >
          commission::most_missed_share * static_cast<double>(filled.q.rows()))
    return {};
  if (ticks.tick.empty()) return {};
  // Rows are counted from tick 0, also if the first ticks have no reading.
  const Eigen::Index late = ticks.tick.front(), rows = filled.q.rows();
  commission::Trial trial{Eigen::MatrixXd(late + rows, filled.q.cols()),
                          Eigen::MatrixXd(late + rows, filled.q.cols())};
  for (const auto& [to, from] : {std::pair{&trial.q, &filled.q}, {&trial.tau, &filled.tau}}) {
    to->topRows(late).rowwise() = from->row(0);
    to->bottomRows(rows) = *from;
  }
  trial.missed = ticks.missed + filled.missing;
  const logger::RunSummary& summary = run.summary();
  if (!summary.faults.empty()) trial.stopped = summary.faults.front().text;
  return trial;
}

struct Commission {
  RunOptions options;
  fs::path output;
  bool replace = false;

  void declare(CLI::App& command) {
    session::with_installed_scenarios(
        session::add_scenario(command, options.scenario, options.overrides));
    auto* driver =
        command.add_option("--plant", options.plant_program,
                           "The arm's driver, as typed in a shell; default: an emulated arm of the "
                           "scenario");
    command.add_option("--out", options.out, "Folder of the logs; default: out/NAME-commission")
        ->needs(driver);
    command.add_option("--write", output, "The scenario with what was found, as a file");
    command.add_flag("--force,--overwrite", replace, "Replace that file if it exists");
    session::add_lcm_url(command, options.lcm_url);
    session::add_key_file(command, options.key_file);
    add_json(command, options.json);
    add_quiet(command, options.quiet);
    command
        .add_flag("-v,--verbose", options.verbose, "Shows what the programs of each trial print")
        ->needs(driver);
  }

  [[nodiscard]] ExitCode run() const {
    require_scenario_writable(output, replace);
    const scenario::Scenario scenario =
        scenario::load_scenario(options.scenario, options.overrides);
    Screen screen(options.quiet);
    const auto show = [&](std::string_view what) {
      screen.show(fmt::format("commission: {}", what));
    };
    commission::EmulatedArm emulated(scenario);
    const commission::Commissioned found = commission::commission(
        scenario, options.plant_program.empty() ? trials_on(emulated) : on_the_bus(scenario), show);
    screen.clear();
    print(options.json, found, commission::text(found, scenario.name));
    const bool writes = !output.empty() && found.mendable;
    for (const std::string& misfit : found.misfits) {
      base::log_error("{}: {}{}", scenario.source, misfit,
                      output.empty() ? ""
                      : writes       ? " (written)"
                                     : "; nothing written");
    }
    if (writes) write_scenario(options.scenario, options.overrides, found.overrides, output);
    return found.misfits.empty() || writes ? ExitCode::done : ExitCode::check_said_no;
  }

 private:
  /// @return nothing if ticks were late or are missing
  static std::optional<commission::Trial> run_once(const RunOptions& next, int number,
                                                   double period_s) {
    const ExitCode code = cli::run(next, {next.scenario});
    const fs::path log = next.out / "lcmlog";
    if (code == ExitCode::check_said_no) return {};
    if (code != ExitCode::done && (code != ExitCode::protective_stop || !fs::exists(log))) {
      throw base::Failure(code, "{}: commissioning ended with run {}: see the line above",
                          next.scenario.string(), number);
    }
    auto trial = read_trial(log, period_s);
    if (!trial || trial->stopped.find("loop.max_missed") != std::string::npos) return {};
    const auto text = base::file_text(next.out / "summary.json").value_or("{}");
    trial->arm_is_clock = base::parse_json(text).value("robot_is_clock", false);
    return trial;
  }

  /// Runs with the driver, each into a numbered folder.
  [[nodiscard]] commission::Trials on_the_bus(const scenario::Scenario& scenario) const {
    RunOptions of = options;
    if (of.out.empty()) of.out = fs::path("out") / (scenario.name + "-commission");
    of.mode = "realtime";
    of.quiet = of.force = of.any_outcome = of.overwrite = of.trial = true;
    of.json = false;
    return [of, number = 0, period_s = scenario.loop.period_s](
               const scenario::Scenario& /*changed*/,
               const std::vector<std::string>& changes) mutable {
      RunOptions next = of;
      next.out /= std::to_string(++number);
      next.overrides.insert(next.overrides.end(), changes.begin(), changes.end());
      return run_once(next, number, period_s);
    };
  }
};

}  // namespace

const Verb commission_verb = verb_of<Commission>(
    "commission", "Checks signs, torque scale, gravity and delay of a new arm before its first run",
    "  tachless commission arm.yaml\n"
    "  tachless commission arm.yaml --plant ./own_driver --write known.yaml");

}  // namespace tachless::cli
