#include "launch/slurm.h"

#include <fmt/format.h>

#include <filesystem>
#include <fstream>

#include "diagnostics/failure.h"
#include "diagnostics/text.h"
#include "process/child.h"

namespace tachless::launch {
namespace {

namespace fs = std::filesystem;

fs::path job_file(const study::Sweep& sweep) { return sweep.directory() / "slurm-job"; }

/// One word of a shell's command.
std::string word(const std::string& text) {
  std::string result = "'";
  for (const char c : text) result += c == '\'' ? "'\\''" : std::string(1, c);
  return result + "'";
}

std::string this_command(const study::Sweep& sweep) {
  return fmt::format("exec {} sweep {}", word(fs::read_symlink("/proc/self/exe").string()),
                     word(fs::absolute(sweep.directory()).string()));
}

/// The number of the job that sbatch has made.
std::string submitted(std::vector<std::string> options, const std::string& script) {
  options.insert(options.begin(), {"sbatch", "--parsable"});
  options.insert(options.end(), {"--wrap", script});
  const process::Finished finished = process::run(options);
  const std::string said = diagnostics::joined(finished.lines, "; ");
  if (!finished.well() || finished.lines.empty()) {
    throw diagnostics::bad_usage("sbatch refuses the sweep: {}", said);
  }
  return finished.lines.back().substr(0, finished.lines.back().find(';'));  // "id;cluster"
}

}  // namespace

std::string submit_to_slurm(const study::Sweep& sweep, int tasks) {
  const std::string directory = fs::absolute(sweep.directory()).string();
  const std::string name = "--job-name=sweep-" + sweep.plan().name;
  const std::string array = submitted(
      {name, fmt::format("--array=1-{}", tasks), "--requeue", "--open-mode=append",
       fmt::format("--output={}/slurm-%a.txt", directory)},
      fmt::format(
          "{} --quiet --shard $SLURM_ARRAY_TASK_ID/{} --threads ${{SLURM_CPUS_PER_TASK:-1}}",
          this_command(sweep), tasks));
  std::ofstream(job_file(sweep)) << array << "\n";
  const std::string merge =
      submitted({name, "--dependency=afterany:" + array, "--requeue", "--open-mode=append",
                 fmt::format("--output={}/slurm-merge.txt", directory)},
                this_command(sweep) + " --merge");
  return fmt::format(
      "job {}: {} tasks, {} runs; job {} merges them into {}/results.csv\n"
      "  tachless sweep {} --status\n",
      array, tasks, sweep.plan().num_cases(), merge, directory, sweep.directory().string());
}

std::string slurm_status(const study::Sweep& sweep) {
  std::string text;
  std::int64_t finished = 0;
  for (const bool each : sweep.finished()) finished += each ? 1 : 0;
  for (const auto& [file, count] : sweep.counts()) {
    text += fmt::format("  {}: {} runs\n", file, count);
  }
  std::ifstream file(job_file(sweep));
  std::string job;
  if (std::getline(file, job) && process::find_program("squeue")) {
    for (const std::string& line :
         process::run({"squeue", "--noheader", "--jobs", job, "--format=task %K: %T on %N %r"})
             .lines) {
      text += "  " + line + "\n";
    }
  }
  return fmt::format("{}: {} of {} runs finished\n{}", sweep.directory().string(), finished,
                     sweep.plan().num_cases(), text);
}

}  // namespace tachless::launch
