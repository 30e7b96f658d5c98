#include "launch/report.h"

#include <iostream>
#include <memory>
#include <optional>

#include "launch/verb.h"

namespace launch::verb {
namespace {

struct Options {
  std::vector<std::filesystem::path> logs;
  std::filesystem::path out;
  std::int64_t run = 0;
};

app::ExitCode report_on(const Options& options) {
  std::vector<RecordedRun> runs;
  for (const auto& log : options.logs) {
    runs.push_back(
        read_recorded_run(log, options.run == 0 ? std::nullopt : std::optional(options.run)));
  }
  label(runs);
  const std::filesystem::path out =
      options.out.empty() ? options.logs.front().parent_path() / "report.html" : options.out;
  write_report(runs, out);
  std::cout << out.string() << "\n";
  return app::ExitCode::done;
}

Verb::Action declare(CLI::App& command) {
  auto options = std::make_shared<Options>();
  command.add_option("LOG", options->logs, "Logs of runs; several are overlaid")->required();
  command.add_option("-o,--output", options->out,
                     "The page; default: report.html beside the first log");
  command.add_option("--run-id", options->run, "Which run, where the logs hold several");
  return [options] { return report_on(*options); };
}

}  // namespace

extern const Verb report;
const Verb report = {"report", "One HTML page with plots; several logs are overlaid",
                     "  tachless report out/paper_rigid/lcmlog\n"
                     "  tachless report out/a/lcmlog out/b/lcmlog -o compare.html",
                     declare};

}  // namespace launch::verb
