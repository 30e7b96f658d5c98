#include "certificate/certify.h"

#include <fmt/core.h>

#include <iostream>
#include <memory>

#include "diagnostics/json_text.h"
#include "diagnostics/logging.h"
#include "diagnostics/unfinished_file.h"
#include "launch/progress_line.h"
#include "launch/verb.h"
#include "node/options.h"
#include "report/certificate_figure.h"

namespace tachless::launch::verb {
namespace {

struct Options {
  std::filesystem::path scenario;
  std::vector<std::string> overrides;
  std::filesystem::path plot;
  bool json = false;
  bool quiet = false;
};

diagnostics::ExitCode certify(const Options& options) {
  const experiment::Scenario scenario =
      experiment::load_scenario(options.scenario, options.overrides);
  for (const std::string& warning : scenario.model->warnings) diagnostics::log_warning(warning);
  const std::string_view remedy = "name another file with --plot";
  if (!options.plot.empty()) diagnostics::UnfinishedFile(options.plot, remedy);  // before the work
  certificate::Certificate result;
  {
    const ProgressLine progress(options.quiet);
    result = certificate::certify(
        scenario, [&](std::string_view what) { progress.show(fmt::format("certify: {}", what)); });
  }
  if (!options.plot.empty()) report::draw_certificate(result, scenario, options.plot);
  if (options.json) {
    nlohmann::ordered_json json = {{"scenario", scenario.name}, {"law", scenario.controller.law}};
    json.update(to_json(result));
    std::cout << diagnostics::json_text(json, 2) << "\n";
  } else {
    std::cout << page(result, scenario);
  }
  const std::vector<std::string> objections = certificate::objections(result);
  for (const std::string& objection : objections) {
    diagnostics::log_error("{}: {}", options.scenario.string(), objection);
  }
  if (!objections.empty()) return diagnostics::ExitCode::check_said_no;
  return diagnostics::ExitCode::done;
}

Verb::Action declare(CLI::App& command) {
  auto options = std::make_shared<Options>();
  node::with_installed_scenarios(
      node::add_scenario(command, options->scenario, options->overrides));
  command.add_option("--plot", options->plot,
                     "An SVG: margin against period, spectral radius along the reference, the "
                     "certified region against the initial state");
  command.add_flag("--json", options->json, "As JSON");
  command.add_flag("-q,--quiet", options->quiet, "No progress on stderr");
  return [options] { return certify(*options); };
}

}  // namespace

extern const Verb certify;
const Verb certify = {
    "certify", "Is a scenario's loop stable, why, and how far? Nothing is run",
    "  tachless certify scenarios/paper_rigid.yaml\n"
    "  tachless certify scenarios/practical_rigid.yaml --set loop.period_s=0.002 --json\n"
    "  tachless certify scenarios/practical_flexible.yaml --plot certificate.svg",
    declare};

}  // namespace tachless::launch::verb
