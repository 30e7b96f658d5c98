// The verbs that run scenarios many times in this process: compare, sweep.

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <iostream>
#include <optional>
#include <string>
#include <vector>

#include "base/parallel.h"
#include "base/text.h"
#include "base/this_process.h"
#include "certify/prediction.h"
#include "cli/progress.h"
#include "cli/sweep.h"
#include "cli/verb.h"
#include "controller/registry.h"
#include "design/design.h"
#include "linear/scenario_loop.h"
#include "report/sweep_page.h"
#include "session/options.h"
#include "study/measures.h"

namespace tachless::cli {
namespace {

namespace fs = std::filesystem;
using base::ExitCode;
using Clock = std::chrono::steady_clock;

/// The laws named by --laws, or with "all" every law made for the scenario's joints and reference.
/// @throw base::Failure(bad_usage) for a name that is no law
std::vector<std::string> laws_of(const scenario::Scenario& scenario,
                                 const std::vector<std::string>& names) {
  std::vector<std::string> result;
  const bool flexible = scenario.robot.flexible.has_value();
  const bool moves = linear::ScenarioLoop(scenario).moves();
  for (const std::string& name : names) {
    if (name != "all") {
      result.emplace_back(controller::law_facts(name).name);
      continue;
    }
    for (const controller::LawFacts& law : controller::laws()) {
      if (law.needs_flexible_joints != flexible || (law.regulation_only && moves)) continue;
      if (law.needs_torque_limit && !controller::has_torque_limits(scenario)) continue;
      result.emplace_back(law.name);
    }
  }
  return result;
}

/// Adds the measures that only a comparison of laws has.
void complete_comparison(const scenario::Scenario& scenario, study::Measures& measures) {
  measures.torque_noise = study::torque_noise(scenario);
  measures.largest_period_s =
      certify::analyse(scenario, linear::Effort::quick).limit_s.value_or(NAN);
}

struct Sweep {
  fs::path input, out;
  std::vector<std::string> overrides, vary, laws;
  double bandwidth_hz = 5;
  std::optional<double> margin;
  std::vector<double> noise_Nm;  ///< empty: the share of the torque limit that design allows
  std::int64_t random = 0;
  std::uint64_t seed = 1;
  int threads = static_cast<int>(base::all_cores());
  std::string shard, colour = "outcome";
  int slurm = 0;
  bool status = false, merge = false, json = false, quiet = false;

  void declare(CLI::App& command) {
    session::with_installed_scenarios(
        command.add_option("SCENARIO", input,
                           "A scenario's file, or the directory of a sweep to resume"))
        ->required();
    command.add_option(
        "--vary", vary,
        "KEY=from:to:number[:log] or KEY=a,b,c; may be repeated: all combinations. KEY*= "
        "multiplies the scenario's value, KEY[0]= sets the first joint's alone");
    session::add_overrides(command, overrides, "key.path=value; may be repeated");
    command
        .add_option("--random", random, "Number of runs with values drawn from KEY=from:to[:log]")
        ->check(above_zero);
    command.add_option("--seed", seed, "Seed of the draws; default: 1")
        ->needs(command.get_option("--random"));
    command
        .add_option("--laws", laws,
                    "Laws in place of the scenario's, each tuned to the bandwidth; all: every law "
                    "for these joints")
        ->delimiter(',');
    add_bandwidth(command)->needs("--laws");
    command.add_option("--colour", colour,
                       "Colour of the map: outcome, or a measure by its name in results.csv");
    command.add_option("--out", out, "Default: out/sweep-<the scenario's name>");
    command.add_option("--threads", threads, "Runs at once; default: all cores")
        ->check(CLI::Range(1, 4096));
    auto* part = command.add_option(
        "--shard", shard, "Only part I of N, as I/N: for job schedulers; --merge joins the parts");
    auto* tasks = command.add_option("--slurm", slurm,
                                     "Submit the sweep to Slurm as an array of this number of "
                                     "tasks, and a last task that merges");
    tasks->check(CLI::Range(1, 100000))->excludes(part);
    auto* only_merge = command.add_flag("--merge", merge,
                                        "Check that all runs are finished, and write the results");
    only_merge->excludes(part)->excludes(tasks);
    auto* count =
        command.add_flag("--status", status, "Print how many runs of each part are finished");
    count->excludes(part)->excludes(tasks)->excludes(only_merge);
    auto* as_json = command.add_flag("--json", json, "Print the summary as JSON");
    as_json->excludes(part)->excludes(tasks)->excludes(count);
    add_quiet(command, quiet);
  }

  /// Without axes: a run of each law.
  void declare_comparison(CLI::App& command) {
    laws = {"all"};
    session::with_installed_scenarios(session::add_scenario(command, input, overrides));
    command
        .add_option("--laws", laws,
                    "Names of laws, separated by commas; default: all, every law for these joints")
        ->delimiter(',');
    auto* bandwidth = add_bandwidth(command);
    auto* modulus =
        command.add_option("--margin", margin,
                           "Instead of --bandwidth: gains of each law by design, with this modulus "
                           "margin. A law for which design finds no gains is left out");
    modulus->check(CLI::Range(0.05, 0.95))->excludes(bandwidth);
    auto* noise = command.add_option("--noise", noise_Nm,
                                     "Largest torques of one encoder count [N m], separated by "
                                     "commas: each law is designed for each of them");
    noise->delimiter(',')->check(above_zero)->needs(modulus);
    command.add_option("--out", out, "Default: out/compare-<the scenario's name>");
    add_json(command, json);
    add_quiet(command, quiet);
  }

  [[nodiscard]] ExitCode run() const {
    const study::Sweep sweep = begun();
    if (!sweep.plan().is_comparison()) (void)report::measures_shown(sweep.plan(), colour);
    if (status) {
      print_text(slurm_status(sweep));
    } else if (slurm > 0) {
      print_text(submit_to_slurm(sweep, slurm, colour));
    } else {
      if (!merge) carry_out(sweep);
      if (shard.empty()) print_text(write_sweep_results(sweep, colour, json));
    }
    return ExitCode::done;
  }

 private:
  CLI::Option* add_bandwidth(CLI::App& command) {
    return command
        .add_option("--bandwidth", bandwidth_hz,
                    "Bandwidth to which each law of --laws is tuned [Hz]; default: 5")
        ->check(CLI::Range(1e-3, 1e5));  // beyond it a gain is 0 or infinite
  }

  [[nodiscard]] study::SweepPlan plan() const {
    const scenario::Scenario scenario = scenario::load_scenario(input, overrides);
    study::SweepPlan plan;
    plan.name = scenario.name;
    plan.source = input.string();
    plan.text = scenario.text;
    plan.urdf = scenario.robot.urdf_text;
    plan.num_joints = scenario.num_joints;
    plan.drawn = random;
    plan.seed = seed;
    for (const std::string& text : vary) plan.add(study::parse_axis(text, random > 0));
    require_place(plan);
    for (const std::string& law : laws_of(scenario, laws)) add_law(scenario, law, plan);
    if (plan.laws.empty() && margin) {
      throw base::Failure(ExitCode::check_said_no, "none of the laws has gains");
    }
    if (plan.laws.empty()) plan.laws.push_back({scenario.controller.law, {}});
    (void)plan.scenario(plan.at(0));  // refuses an axis that is no key before anything is written
    return plan;
  }

  /// Adds a law with the gains of its rule of thumb, or with one design for each noise. A law
  /// without gains is named and left out.
  void add_law(scenario::Scenario scenario, const std::string& law, study::SweepPlan& plan) const {
    scenario.controller.law = law;
    if (!margin) {
      const design::Design rule = design::rule_of_thumb(scenario, bandwidth_hz);
      plan.laws.push_back({law, design::overrides_of(rule, law)});
      return;
    }
    Screen screen(quiet);
    const auto tell = [&](std::string_view what) { screen.show(fmt::format("{}: {}", law, what)); };
    std::vector<std::optional<double>> counts(noise_Nm.begin(), noise_Nm.end());
    if (counts.empty()) counts.emplace_back();
    for (const std::optional<double>& count_Nm : counts) {
      design::DesignGoal goal;
      goal.modulus = *margin;
      goal.count_Nm = count_Nm;
      try {
        study::SweepLaw found{law, design::overrides_of(design::design(scenario, goal, tell), law)};
        const bool known = std::ranges::find(plan.laws, found.overrides,
                                             &study::SweepLaw::overrides) != plan.laws.end();
        if (!known) plan.laws.push_back(std::move(found));
      } catch (const base::Failure& why) {
        if (why.code() != ExitCode::check_said_no) throw;
        screen.pass_on("", "compare", fmt::format("{} has no row: {}", law, why.what()));
      }
    }
  }

  [[nodiscard]] study::Sweep begun() const {
    if (fs::is_directory(input)) {
      if (!vary.empty() || !overrides.empty() || !laws.empty() || random > 0 || !out.empty()) {
        throw base::bad_usage(
            "{}: this sweep has its plan and place; --vary, --random, --set, --laws and --out "
            "belong to a scenario",
            input.string());
      }
      return study::Sweep::open(input);
    }
    if (vary.empty() && (laws.empty() || random > 0)) {
      throw base::bad_usage(
          "nothing to vary: name it with --vary KEY=from:to:number, or laws to compare with "
          "--laws");
    }
    const study::SweepPlan planned = plan();
    return study::Sweep::begin(place(planned), planned);
  }

  [[nodiscard]] fs::path place(const study::SweepPlan& plan) const {
    return out.empty()
               ? fs::path("out") / ((plan.is_comparison() ? "compare-" : "sweep-") + plan.name)
               : out;
  }

  /// Refuses another sweep's directory before the design of laws, which may take minutes.
  void require_place(const study::SweepPlan& plan) const {
    const fs::path directory = place(plan);
    if (!fs::exists(directory / "plan.json")) return;
    study::SweepPlan there = study::Sweep::open(directory).plan();
    there.laws = plan.laws;
    if (there.json() == plan.json()) return;
    throw base::bad_usage(
        "{}: another sweep is in this directory; name another one with --out, or remove it",
        directory.string());
  }

  [[nodiscard]] study::Shard part() const {
    study::Shard part;
    if (shard.empty()) return part;
    int read = 0;
    if (std::sscanf(shard.c_str(), "%d/%d%n", &part.index, &part.count, &read) != 2 ||
        read != static_cast<int>(shard.size()) || part.index < 1 || part.index > part.count) {
      throw base::bad_usage("--shard {}: allowed: I/N, with I from 1 to N", shard);
    }
    return part;
  }

  /// Runs what is to be run. @throw base::Failure(interrupted)
  void carry_out(const study::Sweep& sweep) const {
    const std::atomic<bool>& interrupted = base::catch_interruptions();
    Screen screen(quiet);
    const Clock::time_point begin = Clock::now();
    Clock::time_point next = begin;
    std::int64_t first = -1;
    const auto show = [&](std::int64_t done, std::int64_t all) {
      if (first < 0) first = done - 1;
      const Clock::time_point now = Clock::now();
      if (now < next && done < all) return;
      next = now + std::chrono::milliseconds(200);
      const double passed_s = std::chrono::duration<double>(now - begin).count();
      const double left_s =
          passed_s / static_cast<double>(done - first) * static_cast<double>(all - done);
      screen.show(fmt::format("sweep: {} of {} runs, {:.0f} {} left", done, all,
                              left_s < 90 ? left_s : left_s / 60, left_s < 90 ? "s" : "min"));
    };
    const bool finished = sweep.run(
        part(), threads, [&] { return !interrupted; }, show,
        sweep.plan().is_comparison() ? complete_comparison : study::Sweep::Complete());
    if (!finished) {
      throw base::Failure(ExitCode::interrupted, "interrupted; to resume it: tachless sweep {}",
                          base::shell_word(sweep.directory().string()));
    }
  }
};

struct Compare : Sweep {
  void declare(CLI::App& command) { declare_comparison(command); }
};

}  // namespace

const Verb compare_verb = verb_of<Compare>(
    "compare",
    "Run a scenario under several laws, tuned to one bandwidth: sweep --laws without --vary",
    "  tachless compare scenarios/practical_rigid.yaml\n"
    "  tachless compare scenarios/practical_rigid.yaml --laws loria_ortega_rigid,wen_bayard "
    "--bandwidth 8 --set plant.encoder.resolution_bits=16");

const Verb sweep_verb = verb_of<Sweep>(
    "sweep", "Run a scenario hundreds of times with values varied, over all cores",
    "  tachless sweep scenarios/practical_rigid.yaml --vary 'controller.gains.kp*=0.1:10:21:log' "
    "--vary 'controller.gains.kd*=0.1:10:21:log'\n"
    "  tachless sweep scenarios/practical_rigid.yaml --random 1000 --vary "
    "'plant.initial.position_rad[0]=-1:1' --vary plant.payload.mass_kg=0:2\n"
    "  tachless sweep out/sweep-practical_rigid");

}  // namespace tachless::cli
