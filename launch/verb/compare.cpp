#include "study/compare.h"

#include <fmt/format.h>

#include <iostream>
#include <memory>
#include <system_error>

#include "certificate/design.h"
#include "diagnostics/json_text.h"
#include "launch/laws_of.h"
#include "launch/progress_line.h"
#include "launch/verb.h"
#include "node/options.h"
#include "report/compare_page.h"

namespace tachless::launch::verb {
namespace {

namespace fs = std::filesystem;
using diagnostics::ExitCode;

struct Options {
  fs::path scenario, out;
  std::vector<std::string> overrides, laws = {"all"};
  double bandwidth_hz = 5;
  int seeds = 1;
  bool json = false, quiet = false;
};

ExitCode run_compare(const Options& options) {
  const experiment::Scenario scenario =
      experiment::load_scenario(options.scenario, options.overrides);
  const fs::path out =
      options.out.empty() ? fs::path("out") / ("compare-" + scenario.name) : options.out;
  std::error_code error;
  fs::create_directories(out, error);
  if (error) {
    throw diagnostics::bad_usage("{}: cannot be made: {}; name another one with --out",
                                 out.string(), error.message());
  }
  std::vector<report::ComparedLaw> laws;
  {
    const ProgressLine progress(options.quiet);
    for (const std::string& law : laws_of(scenario, options.laws)) {
      progress.show(fmt::format("compare: {}", law));
      const std::vector<std::string> tuned =
          certificate::rule_of_thumb(scenario, law, options.bandwidth_hz);
      std::vector<std::string> overrides = options.overrides;
      overrides.insert(overrides.end(), tuned.begin(), tuned.end());
      laws.push_back(
          {study::compare(experiment::load_scenario(options.scenario, overrides), options.seeds),
           tuned});
    }
  }
  const std::string rule = fmt::format(
      "Each law tuned by its rule of thumb to two real poles at {:g} Hz, filters and observers ten "
      "times as fast; {} seed{} of the encoders' noise.",
      options.bandwidth_hz, options.seeds, options.seeds == 1 ? "" : "s");
  report::write_comparison(scenario, rule, laws, out);
  if (options.json) {
    std::cout << diagnostics::json_text(report::to_json(laws), 2) << "\n";
  } else {
    std::cout << rule << "\n"
              << comparison_table(laws) << "  " << (out / "index.html").string() << "\n";
  }
  return ExitCode::done;
}

Verb::Action declare(CLI::App& command) {
  auto options = std::make_shared<Options>();
  node::with_installed_scenarios(
      node::add_scenario(command, options->scenario, options->overrides));
  command
      .add_option("--laws", options->laws,
                  "Names, with commas between; default: all, every law for these joints")
      ->delimiter(',');
  command
      .add_option("--bandwidth", options->bandwidth_hz,
                  "To which every law is tuned [Hz]; default: 5")
      ->check(CLI::PositiveNumber);
  command.add_option("--seeds", options->seeds, "Of the encoders' noise; default: 1")
      ->check(CLI::Range(1, 1000));
  command.add_option("--out", options->out, "Default: out/compare-<the scenario's name>");
  command.add_flag("--json", options->json, "As JSON");
  command.add_flag("-q,--quiet", options->quiet, "No progress on stderr");
  return [options] { return run_compare(*options); };
}

}  // namespace

extern const Verb compare;
const Verb compare = {
    "compare", "One scenario under several laws, tuned alike: a table, a figure, a page",
    "  tachless compare scenarios/practical_rigid.yaml\n"
    "  tachless compare scenarios/practical_rigid.yaml --laws loria_ortega_rigid,wen_bayard "
    "--bandwidth 8 --set plant.encoder.resolution_bits=16",
    declare};

}  // namespace tachless::launch::verb
