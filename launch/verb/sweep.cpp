#include "study/sweep.h"

#include <fmt/format.h>

#include <chrono>
#include <iostream>
#include <memory>

#include "certificate/design.h"
#include "certificate/parallel.h"
#include "diagnostics/json_text.h"
#include "launch/laws_of.h"
#include "launch/progress_line.h"
#include "launch/slurm.h"
#include "launch/sweep_results.h"
#include "launch/verb.h"
#include "node/options.h"
#include "process/interruption.h"

namespace tachless::launch::verb {
namespace {

namespace fs = std::filesystem;
using diagnostics::ExitCode;
using diagnostics::Failure;
using Clock = std::chrono::steady_clock;

struct Options {
  fs::path input;
  std::vector<std::string> overrides, vary, laws;
  double bandwidth_hz = 5;
  std::int64_t random = 0;
  std::uint64_t seed = 1;
  fs::path out;
  int threads = static_cast<int>(certificate::all_cores());
  std::string shard, colour = "outcome";
  int slurm = 0;
  bool status = false, merge = false, json = false, quiet = false;
};

study::SweepPlan plan_of(const Options& options) {
  const experiment::Scenario scenario = experiment::load_scenario(options.input, options.overrides);
  study::SweepPlan plan;
  plan.name = scenario.name;
  plan.source = options.input.string();
  plan.text = scenario.text;
  plan.urdf = scenario.robot.urdf_text;
  plan.num_joints = scenario.num_joints;
  plan.drawn = options.random;
  plan.seed = options.seed;
  for (const std::string& text : options.vary) {
    plan.axes.push_back(study::parse_axis(text, options.random > 0));
  }
  for (const std::string& law : laws_of(scenario, options.laws)) {
    plan.laws.push_back({law, certificate::rule_of_thumb(scenario, law, options.bandwidth_hz)});
  }
  if (plan.laws.empty()) plan.laws.push_back({scenario.controller.law, {}});
  return plan;
}

study::Sweep sweep_of(const Options& options) {
  if (fs::is_directory(options.input)) {
    if (!options.vary.empty() || !options.overrides.empty() || !options.laws.empty()) {
      throw diagnostics::bad_usage(
          "{}: this sweep has its plan; --vary, --set and --laws go with a scenario",
          options.input.string());
    }
    return study::Sweep::open(options.input);
  }
  if (options.vary.empty()) {
    throw diagnostics::bad_usage("nothing to vary: name it with --vary KEY=from:to:number");
  }
  const study::SweepPlan plan = plan_of(options);
  return study::Sweep::begin(
      options.out.empty() ? fs::path("out") / ("sweep-" + plan.name) : options.out, plan);
}

study::Shard shard_of(const std::string& text) {
  study::Shard shard;
  if (text.empty()) return shard;
  int read = 0;
  if (std::sscanf(text.c_str(), "%d/%d%n", &shard.index, &shard.count, &read) != 2 ||
      read != static_cast<int>(text.size()) || shard.index < 1 || shard.index > shard.count) {
    throw diagnostics::bad_usage("--shard {}: allowed: I/N, with I from 1 to N", text);
  }
  return shard;
}

std::string time_left(Clock::duration passed, std::int64_t done_now, std::int64_t left) {
  if (done_now == 0) return "";
  const double seconds = std::chrono::duration<double>(passed).count();
  const double rest = seconds / static_cast<double>(done_now) * static_cast<double>(left);
  return rest < 90 ? fmt::format(", {:.0f} s left", rest)
                   : fmt::format(", {:.0f} min left", rest / 60);
}

/// Runs what is to be run. @return whether the shard is finished.
bool carry_out(const study::Sweep& sweep, const Options& options) {
  const std::atomic<bool>& interrupted = process::catch_interruptions();
  const ProgressLine progress(options.quiet);
  const Clock::time_point begun = Clock::now();
  Clock::time_point next = begun;
  std::int64_t first = -1;
  return sweep.run(
      shard_of(options.shard), options.threads, [&] { return !interrupted; },
      [&](std::int64_t done, std::int64_t all) {
        if (first < 0) first = done - 1;
        const Clock::time_point now = Clock::now();
        if (now < next && done < all) return;
        next = now + std::chrono::milliseconds(200);
        progress.show(fmt::format("sweep: {} of {} runs{}", done, all,
                                  time_left(now - begun, done - first, all - done)));
      });
}

ExitCode run_sweep(const Options& options) {
  const study::Sweep sweep = sweep_of(options);
  if (options.status) {
    std::cout << slurm_status(sweep);
    return ExitCode::done;
  }
  if (options.slurm > 0) {
    std::cout << submit_to_slurm(sweep, options.slurm);
    return ExitCode::done;
  }
  if (!options.merge && !carry_out(sweep, options)) {
    throw Failure(ExitCode::interrupted, "interrupted; go on with: tachless sweep {}",
                  sweep.directory().string());
  }
  if (options.shard.empty()) {
    const SweepResults results = write_sweep_results(sweep, options.colour);
    std::cout << (options.json ? diagnostics::json_text(to_json(results), 2) + "\n"
                               : to_text(results));
  }
  return ExitCode::done;
}

Verb::Action declare(CLI::App& command) {
  auto options = std::make_shared<Options>();
  node::with_installed_scenarios(
      command.add_option("SCENARIO", options->input,
                         "A scenario's file, or the directory of a sweep to go on with"))
      ->required();
  command
      .add_option("--vary", options->vary,
                  "KEY=from:to:number[:log] or KEY=a,b,c; may be repeated: all combinations. KEY*= "
                  "multiplies what the scenario has, KEY[0]= is the first joint's alone")
      ->allow_extra_args(false);
  command.add_option("--set", options->overrides, "key.path=value; may be repeated")
      ->allow_extra_args(false);
  command
      .add_option("--random", options->random,
                  "That many runs with values drawn from KEY=from:to[:log]")
      ->check(CLI::PositiveNumber);
  command.add_option("--seed", options->seed, "Of the draws; default: 1");
  command
      .add_option("--laws", options->laws,
                  "Laws in place of the scenario's, each tuned to the bandwidth; all: every law "
                  "for these joints")
      ->delimiter(',');
  command
      .add_option("--bandwidth", options->bandwidth_hz, "Of the laws of --laws [Hz]; default: 5")
      ->check(CLI::PositiveNumber);
  command.add_option("--colour", options->colour,
                     "What the map shows: outcome, or a measure by its name in results.csv");
  command.add_option("--out", options->out, "Default: out/sweep-<the scenario's name>");
  command.add_option("--threads", options->threads, "Runs at once; default: all cores")
      ->check(CLI::Range(1, 4096));
  auto* shard = command.add_option(
      "--shard", options->shard,
      "Only part I of N, as I/N: for whatever starts many; --merge puts them together");
  auto* slurm = command.add_option(
      "--slurm", options->slurm,
      "Submit it to Slurm as an array of that many tasks, with a last one that merges");
  slurm->check(CLI::Range(1, 100000))->excludes(shard);
  auto* merge =
      command.add_flag("--merge", options->merge, "Check that all is there, and write it");
  merge->excludes(shard)->excludes(slurm);
  command.add_flag("--status", options->status, "How many runs of each part are finished")
      ->excludes(shard)
      ->excludes(slurm)
      ->excludes(merge);
  command.add_flag("--json", options->json, "The closing words as JSON");
  command.add_flag("-q,--quiet", options->quiet, "No progress on stderr");
  return [options] { return run_sweep(*options); };
}

}  // namespace

extern const Verb sweep;
const Verb sweep = {
    "sweep", "Run a scenario hundreds of times with values varied, over all cores",
    "  tachless sweep scenarios/practical_rigid.yaml --vary 'controller.gains.kp*=0.1:10:21:log' "
    "--vary 'controller.gains.kd*=0.1:10:21:log'\n"
    "  tachless sweep scenarios/practical_rigid.yaml --random 1000 --vary "
    "'plant.initial.position_rad[0]=-1:1' --vary plant.payload.mass_kg=0:2\n"
    "  tachless sweep out/sweep-practical_rigid",
    declare};

}  // namespace tachless::launch::verb
