#include "logger/info.h"

#include <iostream>
#include <memory>

#include "diagnostics/json_text.h"
#include "launch/verb.h"

namespace tachless::launch::verb {
namespace {

struct Options {
  std::filesystem::path log;
  bool json = false;
};

Verb::Action declare(CLI::App& command) {
  auto options = std::make_shared<Options>();
  with_directories(
      command.add_option("LOG", options->log, "Any LCM log, or the directory of a run"))
      ->required();
  command.add_flag("--json", options->json, "As JSON");
  return [options] {
    const nlohmann::json info = logger::read_info(options->log);
    std::cout << (options->json ? diagnostics::json_text(info, 2) + "\n" : logger::to_text(info));
    return diagnostics::ExitCode::done;
  };
}

}  // namespace

extern const Verb info;
const Verb info = {"info", "What is in a log: channels, rates, the run's facts, gaps, damage",
                   "  tachless info out/paper_rigid\n"
                   "  tachless info lcmlog-2024-05-01.00 --json",
                   declare};

}  // namespace tachless::launch::verb
