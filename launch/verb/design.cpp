#include "certificate/design.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iostream>
#include <memory>
#include <numbers>
#include <stdexcept>
#include <utility>

#include "certificate/sampled_certificate.h"
#include "diagnostics/file_text.h"
#include "diagnostics/logging.h"
#include "diagnostics/unfinished_file.h"
#include "experiment/scenario.h"
#include "launch/progress_line.h"
#include "launch/verb.h"
#include "node/options.h"

namespace tachless::launch::verb {
namespace {

namespace fs = std::filesystem;
using diagnostics::ExitCode;

struct Options {
  fs::path input;
  std::vector<std::string> overrides;
  certificate::DesignGoal goal;
  double period_s = 0;
  fs::path write;
  bool quiet = false;

  [[nodiscard]] bool bare_urdf() const { return input.extension() == ".urdf"; }
};

/// The scenario of a bare URDF, from text.
struct Urdf {
  std::string urdf_text, scenario_text;
};

Urdf read_urdf(const Options& options) {
  Urdf urdf{diagnostics::given_text(options.input), {}};
  try {
    const robot::Model model = robot::read_urdf(urdf.urdf_text, options.input.string(),
                                                experiment::urdf_options(options.overrides));
    urdf.scenario_text = experiment::urdf_scenario(model, options.input.stem().string(),
                                                   fs::absolute(options.input).string(),
                                                   options.period_s > 0 ? options.period_s : 1e-3);
  } catch (const std::invalid_argument& problem) {
    throw diagnostics::bad_usage(problem.what());
  }
  return urdf;
}

/// The scenario with these overrides.
experiment::Scenario load(const Options& options, std::vector<std::string> overrides) {
  if (options.period_s > 0) overrides.push_back(fmt::format("loop.period_s={}", options.period_s));
  overrides.insert(overrides.begin(), options.overrides.begin(), options.overrides.end());
  if (!options.bare_urdf()) return experiment::load_scenario(options.input, overrides);
  const Urdf urdf = read_urdf(options);
  return experiment::parse_scenario(urdf.scenario_text, urdf.urdf_text, options.input.string(),
                                    overrides);
}

/// The scenario with the design's gains, as text that can stand anywhere: its URDF has an absolute
/// path.
std::string designed_text(const Options& options, const experiment::Scenario& scenario,
                          const certificate::Design& design) {
  std::vector<std::string> overrides = certificate::overrides_of(design);
  if (options.bare_urdf()) {
    // The scenario goes on for 3 s after its motion: as long as the slowest error needs to vanish.
    const double h = scenario.loop.period_s;
    const double longer = std::max(0.0, 1.5 * design.settling_s - 3);
    const double ticks = std::ceil((scenario.loop.duration_s + longer) / h);
    overrides.push_back(fmt::format("loop.duration_s={:.12g}", ticks * h));
  } else {
    const fs::path urdf = options.input.parent_path() / scenario.robot.urdf_path;
    overrides.push_back("robot.urdf=" + fs::absolute(urdf).lexically_normal().string());
    if (scenario.believed_model) {
      const fs::path believed = options.input.parent_path() / scenario.controller.urdf_path;
      overrides.push_back("controller.urdf=" + fs::absolute(believed).lexically_normal().string());
    }
  }
  return load(options, std::move(overrides)).text;
}

void print(const certificate::Design& design, const experiment::Scenario& scenario) {
  std::cout << fmt::format(
      "{}: gains of {} at h = {}, delay {}\n", scenario.name, scenario.controller.law,
      certificate::period_text(scenario.loop.period_s), scenario.loop.command_delay);
  for (const std::string& gain : certificate::overrides_of(design)) {
    std::cout << fmt::format("  --set '{}'\n", gain);
  }
  std::cout << fmt::format(
      "  bandwidth {:.3g} Hz, damping {:g}{}; what binds: {}\n"
      "  at {} postures: modulus margin {:.2g}, gain margin {:.2g}, phase margin {:.0f} deg\n"
      "  settles to 1 % in {:.2g} s\n",
      design.w / (2 * std::numbers::pi), design.damping,
      design.filter_ratio > 0 ? fmt::format(", filters {:.3g} times as fast", design.filter_ratio)
                              : "",
      design.binds, design.postures, design.modulus, design.gain_margin, design.phase_margin_deg,
      design.settling_s);
  if (design.certified_error.size() > 0) {
    std::cout << fmt::format(
        "  certified (sampled) from rest up to |e_i| = [{:.3g}], one at a time\n",
        fmt::join(design.certified_error, ", "));
  }
}

ExitCode run_design(const Options& options) {
  const experiment::Scenario scenario = load(options, {});
  for (const std::string& warning : scenario.model->warnings) diagnostics::log_warning(warning);
  const std::string_view remedy = "name another file with --write";
  if (!options.write.empty())
    diagnostics::UnfinishedFile(options.write, remedy);  // before the work
  certificate::Design design;
  {
    const ProgressLine progress(options.quiet);
    design = certificate::design(scenario, options.goal,
                                 [&](std::string_view what) { progress.show(what); });
  }
  print(design, scenario);
  if (!options.write.empty()) {
    diagnostics::UnfinishedFile(options.write, remedy)
        .write(designed_text(options, scenario, design));
    std::cout << fmt::format("  {}\n", options.write.string());
  }
  if (!design.missed) return ExitCode::done;
  diagnostics::log_error("{}: settling in {:g} s is not reached, but in {:.2g} s: {} binds",
                         options.input.string(), *design.missed, design.settling_s, design.binds);
  return ExitCode::check_said_no;
}

Verb::Action declare(CLI::App& command) {
  auto options = std::make_shared<Options>();
  node::with_installed_scenarios(
      command.add_option("SCENARIO", options->input, "A scenario, or a URDF file"))
      ->required();
  command.add_option("--set", options->overrides, "key.path=value; may be repeated")
      ->allow_extra_args(false);
  auto* bandwidth = command.add_option("--bandwidth", options->goal.bandwidth_hz,
                                       "At most [Hz]; default: 0.005 of the sampling rate");
  bandwidth->check(CLI::PositiveNumber);
  command.add_option("--settling", options->goal.settling_s, "To 1 % of an error [s]")
      ->check(CLI::PositiveNumber)
      ->excludes(bandwidth);
  command.add_option("--margin", options->goal.modulus, "Least modulus margin; default: 0.5")
      ->check(CLI::Range(0.05, 0.95));
  command
      .add_option(
          "--count-share", options->goal.count_share,
          "Largest torque of one encoder count, as a part of the torque limit; default: 0.01")
      ->check(CLI::PositiveNumber);
  command
      .add_option("--period", options->period_s,
                  "Sampling period [s]; default: the scenario's, 1 ms for a URDF")
      ->check(CLI::PositiveNumber);
  command.add_option("--write", options->write, "The scenario with these gains, as a file");
  command.add_flag("-q,--quiet", options->quiet, "No progress on stderr");
  return [options] { return run_design(*options); };
}

}  // namespace

extern const Verb design;
const Verb design = {
    "design", "Gains that keep a margin, for a scenario's law or for a bare URDF",
    "  tachless design scenarios/practical_rigid.yaml --settling 0.2\n"
    "  tachless design robot.urdf --bandwidth 3 --write robot.yaml && tachless run robot.yaml",
    declare};

}  // namespace tachless::launch::verb
