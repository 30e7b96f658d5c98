// The verbs that read logs of runs: info, export, report, replay.

#include <fmt/core.h>

#include <CLI/CLI.hpp>
#include <chrono>
#include <filesystem>
#include <iostream>
#include <optional>
#include <string>
#include <system_error>
#include <vector>

#include "base/clock.h"
#include "base/failure.h"
#include "base/json_text.h"
#include "base/logging.h"
#include "base/text.h"
#include "certify/certify.h"
#include "cli/run.h"
#include "cli/verb.h"
#include "logger/export.h"
#include "logger/info.h"
#include "logger/log_file.h"
#include "replay/replay.h"
#include "report/report.h"
#include "robot/model.h"
#include "session/options.h"

namespace tachless::cli {
namespace {

namespace fs = std::filesystem;
using base::ExitCode;
using Json = nlohmann::ordered_json;

/// LOG, as logger::find_log takes it.
template <class Logs>
void add_logs(CLI::App& command, Logs& logs, const std::string& does) {
  command.add_option("LOG", logs, does)->required()->transform([](const std::string& path) {
    return logger::find_log(path).string();
  });
}

/// @param where "the log holds"
void add_run_id(CLI::App& command, std::optional<std::int64_t>& run_id, const std::string& where) {
  session::as_run_id(
      command.add_option("--run-id", run_id, fmt::format("Id of the run, if {} several", where)));
}

void require_other(const fs::path& output, const fs::path& log) {
  std::error_code error;
  if (!fs::equivalent(output, log, error)) return;
  throw base::bad_usage("{}: is the log that is read; name another file", output.string());
}

struct Info {
  fs::path log;
  bool json = false;

  void declare(CLI::App& command) {
    add_logs(command, log, "Any LCM log, or the directory of a run or of several: then the newest");
    add_json(command, json);
  }

  [[nodiscard]] ExitCode run() const {
    const nlohmann::json info = logger::read_info(log);
    print_text(json ? base::json_text(info, 2) + "\n" : logger::to_text(info));
    return ExitCode::done;
  }
};

struct Export {
  fs::path log, out;
  std::optional<std::int64_t> run_id;
  bool force = false;

  void declare(CLI::App& command) {
    add_logs(command, log, "The log of a run, or its directory");
    command.add_option("-o,--output", out, "F.csv or F.mcap; -: the table to standard output")
        ->required();
    add_run_id(command, run_id, "the log holds");
    command.add_flag("--force", force, "Replace the file if it exists");
  }

  [[nodiscard]] ExitCode run() const {
    require_other(out, log);
    logger::RunLog opened = logger::RunLog::open(log, run_id);
    const logger::ExportResult result = logger::export_run(opened, out, force);
    // Standard output has the table.
    (out == "-" ? std::cerr : std::cout)
        << base::printable(out.string()) << ": " << result.text() << "\n";
    return ExitCode::done;
  }
};

struct Report {
  std::vector<fs::path> logs;
  fs::path out;
  std::optional<std::int64_t> run_id;
  bool force = false;

  void declare(CLI::App& command) {
    add_logs(command, logs, "Logs of runs, or their directories; several are overlaid");
    command.add_option("-o,--output", out,
                       "The page; default: report.html beside a run's lcmlog, LOG.html beside "
                       "another log; needed for several logs");
    command.add_flag("--force", force, "Replace the file that -o names if it exists");
    add_run_id(command, run_id, "the logs hold");
  }

  [[nodiscard]] ExitCode run() const {
    const fs::path page = page_path();
    std::vector<report::RecordedRun> runs;
    for (const fs::path& log : logs) {
      runs.push_back(report::read_recorded_run(log, run_id, certify::certified_run));
    }
    label(runs);
    report::write_report(runs, page);
    std::cout << base::printable(page.string()) << "\n";
    return ExitCode::done;
  }

 private:
  /// Returns the page's name. Without -o, the page replaces only the page of the same log.
  [[nodiscard]] fs::path page_path() const {
    std::error_code error;
    if (!out.empty()) {
      for (const fs::path& log : logs) require_other(out, log);
      if (fs::is_regular_file(out, error) && !force) {
        throw base::bad_usage("{}: exists already; name another file, or overwrite it with --force",
                              out.string());
      }
      return out;
    }
    const fs::path& log = logs.front();
    if (logs.size() > 1) {
      throw base::bad_usage("a report of several logs: name its page with -o PAGE.html");
    }
    return log.filename() == "lcmlog" ? log.parent_path() / "report.html"
                                      : fs::path(log.string() + ".html");
  }
};

struct Replay {
  fs::path log, out;
  std::optional<std::int64_t> run_id;
  std::string law, law_program;
  std::vector<std::string> overrides;
  bool json = false;

  void declare(CLI::App& command) {
    add_logs(command, log, "The log of a run, or its directory");
    add_run_id(command, run_id, "the log holds");
    auto* of_name = command.add_option("--law", law, "Computes the commands of this law instead");
    command
        .add_option("--controller", law_program,
                    "Program with the recorded law or with another law, as typed in a shell; the "
                    "law gets the recorded measurements and references")
        ->excludes(of_name);
    session::add_overrides(
        command, overrides,
        "key.path=value: computes the commands with this value. May be repeated");
    command.add_option("--out", out,
                       "With --law or --set: where replay.csv goes; default: beside the log");
    add_json(command, json);
  }

  [[nodiscard]] ExitCode run() const {
    logger::RunLog opened = logger::RunLog::open(log, run_id);
    const robot::JointLabels joints =
        robot::joint_labels(controller::rigid_model(opened.scenario()));
    const std::vector<std::string> changed = changes(opened);
    if (changed.empty() && !out.empty()) {
      throw base::bad_usage(
          "--out {}: a replay of what was recorded writes no table; name what is to be changed "
          "with --law or --set",
          out.string());
    }
    return changed.empty() ? verify(opened, joints) : compare(changed, opened, joints);
  }

 private:
  /// Returns the settings that put the requested law in the place of the recorded one.
  [[nodiscard]] std::vector<std::string> changes(const logger::RunLog& recorded) const {
    std::vector<std::string> all;
    if (!law.empty()) all.push_back("controller.law=" + law);
    if (!law_program.empty() &&
        recorded.scenario().controller.law != controller::external_law_name) {
      all.push_back(fmt::format("controller.law={}", controller::external_law_name));
      all.push_back("controller.measurement=" + recorded.info().measurement);
    }
    all.insert(all.end(), overrides.begin(), overrides.end());
    return all;
  }

  static Json head(const logger::RunLog& recorded, const scenario::Scenario& replayed) {
    return {{"log", recorded.path().string()},
            {"run_id", recorded.run()},
            {"law", replayed.controller.law_text()}};
  }

  static void warn_of_damage(const logger::RunLog& recorded) {
    const std::string damage = replay::damage_text(recorded);
    if (!damage.empty()) base::log_warning(damage);
  }

  ExitCode verify(logger::RunLog& recorded, const robot::JointLabels& joints) const {
    const scenario::Scenario& scenario = recorded.scenario();
    const auto begun = std::chrono::steady_clock::now();
    const replay::Replay result =
        replay::replay(recorded, scenario, make_law(law_program)(scenario));
    const double wall_s = base::seconds_of(std::chrono::steady_clock::now() - begun);
    const std::string problem = replay::problem_text(result, recorded, joints);
    warn_of_damage(recorded);
    if (json) {
      Json all = head(recorded, scenario);
      all["same"] = problem.empty();
      all.update(to_json(result));
      all["wall_s"] = wall_s;
      std::cout << base::json_text(all, 2) << "\n";
    } else if (problem.empty()) {
      print_text(replay::verified_text(result, recorded, wall_s));
    }
    if (problem.empty()) return ExitCode::done;
    base::log_error(problem);
    return ExitCode::check_said_no;
  }

  ExitCode compare(const std::vector<std::string>& changed, logger::RunLog& recorded,
                   const robot::JointLabels& joints) const {
    const replay::Comparison comparison =
        replay::compare(recorded, changed, make_law(law_program), out, joints);
    const replay::Replay& result = comparison.replay;
    const bool compared = result.compared > 0;
    warn_of_damage(recorded);
    const std::string hindrance = replay::hindrance(result, recorded);
    if (!hindrance.empty()) {
      base::log_warning("{}: {}", recorded.path().string(), hindrance);
    }
    if (json) {
      Json all = head(recorded, comparison.scenario);
      all["set"] = changed;
      all.update(to_json(result));
      all["csv"] = comparison.csv.string();
      std::cout << base::json_text(all, 2) << "\n";
    } else if (compared) {
      print_text(replay::comparison_text(comparison, joints, recorded.info().period_s));
    }
    if (result.not_finite) return ExitCode::protective_stop;
    return compared ? ExitCode::done : ExitCode::check_said_no;
  }
};

}  // namespace

const Verb info_verb = verb_of<Info>(
    "info", "Shows the contents of a log: channels, rates, the run's facts, gaps, damage",
    "  tachless info out/paper_rigid\n"
    "  tachless info lcmlog-2024-05-01.00 --json");

const Verb export_verb = verb_of<Export>(
    "export", "Writes a run for other programs: as a table, one row per tick, or as MCAP",
    "  tachless export out/paper_rigid -o run.csv\n"
    "  tachless export out/paper_rigid -o run.mcap\n"
    "  tachless export out/paper_rigid -o - | cut -d, -f 2-4");

const Verb report_verb = verb_of<Report>(
    "report", "Makes an HTML page with plots and the moving robot; several logs are overlaid",
    "  tachless report out/paper_rigid\n"
    "  tachless report out/a out/b -o compare.html");

const Verb replay_verb = verb_of<Replay>(
    "replay", "Re-runs the controller on logged inputs and compares bit for bit",
    "  tachless replay out/paper_rigid\n"
    "  tachless replay out/paper_rigid --set 'controller.gains.kp=[400, 300]'\n"
    "  tachless replay out/paper_rigid --law numerical_difference --set 'controller.gains={kp: "
    "400, kd: 40, samples: 2}' --out out/what_if");

}  // namespace tachless::cli
