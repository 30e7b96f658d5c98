#include <iostream>
#include <memory>
#include <optional>

#include "launch/verb.h"
#include "logger/export.h"

namespace tachless::launch::verb {
namespace {

struct Options {
  std::filesystem::path log;
  std::filesystem::path out;
  std::int64_t run = 0;
  bool force = false;
};

diagnostics::ExitCode export_to(const Options& options) {
  const logger::ExportFormat format = logger::export_format_of(options.out);
  logger::RunLog log = logger::RunLog::open(
      options.log, options.run == 0 ? std::nullopt : std::optional(options.run));
  const logger::ExportResult result = logger::export_run(log, options.out, format, options.force);
  // Standard output has the table.
  (options.out == "-" ? std::cerr : std::cout)
      << options.out.string() << ": " << result.text() << "\n";
  return diagnostics::ExitCode::done;
}

Verb::Action declare(CLI::App& command) {
  auto options = std::make_shared<Options>();
  with_directories(command.add_option("LOG", options->log, "The log of a run, or its directory"))
      ->required();
  command
      .add_option("-o,--output", options->out, "F.csv, or F.h5 (HDF5); -: CSV to standard output")
      ->required();
  command.add_option("--run-id", options->run, "Which run, where the log holds several");
  command.add_flag("--force", options->force, "Replace the file if it exists");
  return [options] { return export_to(*options); };
}

}  // namespace

extern const Verb export_log;
const Verb export_log = {"export", "A run as a table for other programs: one row per tick",
                         "  tachless export out/paper_rigid -o run.csv\n"
                         "  tachless export out/paper_rigid -o - | cut -d, -f 2-4\n"
                         "  tachless export out/paper_rigid/lcmlog -o run.h5 --force",
                         declare};

}  // namespace tachless::launch::verb
