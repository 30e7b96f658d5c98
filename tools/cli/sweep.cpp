#include "cli/sweep.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <vector>

#include "base/child.h"
#include "base/failure.h"
#include "base/file_text.h"
#include "base/json_text.h"
#include "base/text.h"
#include "certify/prediction.h"
#include "lyapunov/stability_certificate.h"
#include "report/sweep_page.h"

namespace tachless::cli {
namespace {

namespace fs = std::filesystem;
using Outcomes = std::map<std::string, std::int64_t>;  // number of runs for each way to end

constexpr const char* remedy = "make room there";

/// Returns a comparison's table, with a row of measures for each law, for people.
std::string comparison_table(const study::SweepPlan& plan,
                             const std::vector<study::SweepRow>& rows) {
  const robot::JointLabels joints = robot::joint_labels(*plan.scenario(plan.at(0)).model);
  const auto columns = study::measure_columns(true);
  std::vector<std::vector<std::string>> cells = {{"law", "outcome"}, {"", ""}};
  for (const study::MeasureColumn& column : columns) {
    cells[0].emplace_back(column.name);
    cells[1].emplace_back(study::unit_of(column, joints));
  }
  for (const study::SweepRow& row : rows) {
    cells.push_back({row.which.law, std::string(base::name_of(row.outcome))});
    for (const double value : row.measures) {
      cells.back().push_back(std::isfinite(value) ? fmt::format("{:.3g}", value) : "-");
    }
    cells.back().push_back(row.stopped);
  }
  return base::table(cells, "ll" + std::string(columns.size(), 'r') + "l");
}

/// Returns the same as JSON; null: there is no such number.
nlohmann::ordered_json comparison_json(const study::SweepPlan& plan,
                                       const std::vector<study::SweepRow>& rows) {
  auto json = nlohmann::ordered_json::array();
  for (const study::SweepRow& row : rows) {
    nlohmann::ordered_json law = {
        {"law", row.which.law},
        {"set", plan.laws[static_cast<std::size_t>(row.which.index)].overrides},
        {"outcome", base::name_of(row.outcome)}};
    for (std::size_t i = 0; i < row.measures.size(); ++i) {
      const double value = row.measures[i];
      law[std::string(study::measure_columns(true)[i].name)] =
          std::isfinite(value) ? nlohmann::ordered_json(value) : nullptr;
    }
    if (!row.stopped.empty()) law["stopped"] = row.stopped;
    json.push_back(law);
  }
  return json;
}

/// Returns each law's outline of the certified starts, on a map over the initial positions of two
/// joints.
report::Outlines certified_starts(const study::SweepPlan& plan) {
  const auto of_joint = [](const study::Axis& axis) {
    return axis.key == "plant.initial.position_rad" && !axis.factor && axis.entry;
  };
  if (plan.axes.size() != 2 || !std::ranges::all_of(plan.axes, of_joint)) return {};
  report::Outlines outlines;
  for (std::int64_t first = 0; first < plan.num_cases(); first += plan.cases_per_law()) {
    auto& outline = outlines.emplace_back();
    const scenario::Scenario scenario = plan.scenario(plan.at(first));
    if (!certify::no_region(certify::analyse(scenario, linear::Effort::quick)).empty()) continue;
    for (const Eigen::Vector2d& at :
         lyapunov::certified_outline(scenario, *plan.axes[0].entry, *plan.axes[1].entry)) {
      outline.push_back({at[0], at[1]});
    }
  }
  return outlines;
}

fs::path job_file(const study::Sweep& sweep) { return sweep.directory() / "slurm-job"; }

/// Returns `text` as one word of a shell's command.
std::string word(const std::string& text) {
  std::string result = "'";
  for (const char c : text) result += c == '\'' ? "'\\''" : std::string(1, c);
  return result + "'";
}

/// Submits this program's `sweep` with `arguments` to sbatch, and returns the job's number.
std::string submitted(const study::Sweep& sweep, std::vector<std::string> options,
                      const std::string& arguments) {
  options.insert(options.begin(),
                 {"sbatch", "--parsable", "--job-name=sweep-" + sweep.plan().name});
  options.insert(
      options.end(),
      {"--requeue", "--open-mode=append", "--wrap",
       fmt::format("exec {} sweep {} {}", word(fs::read_symlink("/proc/self/exe").string()),
                   word(fs::absolute(sweep.directory()).string()), arguments)});
  const base::Finished finished = base::run(options);
  if (!finished.well() || finished.lines.empty()) {
    throw base::bad_usage("sbatch refuses the sweep: {}", base::joined(finished.lines, "; "));
  }
  return finished.lines.back().substr(0, finished.lines.back().find(';'));  // "id;cluster"
}

}  // namespace

std::string write_sweep_results(const study::Sweep& sweep, const std::string& colour, bool json) {
  const std::vector<study::SweepRow> rows = sweep.rows();
  const fs::path& directory = sweep.directory();
  Outcomes outcomes;
  for (const study::SweepRow& row : rows) ++outcomes[std::string(base::name_of(row.outcome))];
  base::UnfinishedFile(directory / "results.csv", remedy).write(sweep.table(rows));
  report::write_sweep_page(sweep.plan(), rows, colour, directory, certified_starts(sweep.plan()));
  const bool comparison = sweep.plan().is_comparison();
  std::vector<std::string> parts;
  for (const auto& [outcome, count] : outcomes)
    parts.push_back(fmt::format("{} {}", count, outcome));
  const std::string text = fmt::format(
      "{}{} runs: {}\n  {}\n  {}\n", comparison ? comparison_table(sweep.plan(), rows) : "",
      rows.size(), base::joined(parts), (directory / "results.csv").string(),
      (directory / "index.html").string());
  if (!json) return text;
  nlohmann::ordered_json all = {
      {"directory", directory.string()}, {"runs", rows.size()}, {"outcomes", outcomes}};
  if (comparison) all["laws"] = comparison_json(sweep.plan(), rows);
  all["text"] = text;
  return base::json_text(all, 2) + "\n";
}

std::string submit_to_slurm(const study::Sweep& sweep, int tasks, const std::string& colour) {
  const std::string directory = fs::absolute(sweep.directory()).string();
  const std::string array = submitted(
      sweep,
      {fmt::format("--array=1-{}", tasks), fmt::format("--output={}/slurm-%a.txt", directory)},
      fmt::format("--quiet --shard $SLURM_ARRAY_TASK_ID/{} --threads ${{SLURM_CPUS_PER_TASK:-1}}",
                  tasks));
  std::ofstream(job_file(sweep)) << array << "\n";
  const std::string merge = submitted(
      sweep,
      {"--dependency=afterany:" + array, fmt::format("--output={}/slurm-merge.txt", directory)},
      "--merge --colour " + word(colour));
  return fmt::format(
      "job {}: {} tasks, {} runs; job {} merges them into {}/results.csv\n"
      "  tachless sweep {} --status\n",
      array, tasks, sweep.plan().num_cases(), merge, directory,
      base::shell_word(sweep.directory().string()));
}

std::string slurm_status(const study::Sweep& sweep) {
  std::string text;
  const auto finished = std::ranges::count(sweep.finished(), true);
  for (const auto& [file, count] : sweep.counts()) {
    text += fmt::format("  {}: {} runs\n", file, count);
  }
  std::ifstream file(job_file(sweep));
  std::string job;
  if (std::getline(file, job) && base::find_program("squeue")) {
    for (const std::string& line :
         base::run({"squeue", "--noheader", "--jobs", job, "--format=task %K: %T on %N %r"})
             .lines) {
      text += "  " + base::printable(line) + "\n";
    }
  }
  return fmt::format("{}: {} of {} runs finished\n{}", sweep.directory().string(), finished,
                     sweep.plan().num_cases(), text);
}

}  // namespace tachless::cli
