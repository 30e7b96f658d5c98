#include "report/report.h"

#include <iostream>
#include <memory>
#include <optional>

#include "certificate/stability_certificate.h"
#include "launch/verb.h"

namespace tachless::launch::verb {
namespace {

struct Options {
  std::vector<std::filesystem::path> logs;
  std::filesystem::path out;
  std::int64_t run = 0;
};

diagnostics::ExitCode report_on(const Options& options) {
  std::vector<report::RecordedRun> runs;
  for (const auto& log : options.logs) {
    runs.push_back(
        report::read_recorded_run(log, options.run == 0 ? std::nullopt : std::optional(options.run),
                                  certificate::certified_run));
  }
  label(runs);
  const std::filesystem::path out =
      options.out.empty() ? options.logs.front().parent_path() / "report.html" : options.out;
  report::write_report(runs, out);
  std::cout << out.string() << "\n";
  return diagnostics::ExitCode::done;
}

Verb::Action declare(CLI::App& command) {
  auto options = std::make_shared<Options>();
  with_directories(command.add_option("LOG", options->logs,
                                      "Logs of runs, or their directories; several are overlaid"))
      ->required();
  command.add_option("-o,--output", options->out,
                     "The page; default: report.html beside the first log");
  command.add_option("--run-id", options->run, "Which run, where the logs hold several");
  return [options] { return report_on(*options); };
}

}  // namespace

extern const Verb report;
const Verb report = {"report",
                     "One HTML page with plots and the moving robot; several logs are overlaid",
                     "  tachless report out/paper_rigid/lcmlog\n"
                     "  tachless report out/a out/b -o compare.html",
                     declare};

}  // namespace tachless::launch::verb
