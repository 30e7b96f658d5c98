#include "plant/drivers/program.h"

#include <fmt/core.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <string_view>
#include <thread>
#include <utility>

#include "base/failure.h"
#include "base/logging.h"
#include "base/this_process.h"
#include "session/options.h"

namespace tachless::plant {
namespace {

std::string second_word(const std::string& line) {
  const std::size_t begin = line.find(' ') + 1;
  return line.substr(begin, line.find(' ', begin) - begin);
}

void print_help(const DriverProgram& program) {
  fmt::print(
      "{}.\n"
      "Usage: {} [OPTIONS] SCENARIO\n\n"
      "Positionals:\n"
      "  SCENARIO TEXT REQUIRED      The experiment, a YAML file with plant.driver\n\n"
      "Options:\n"
      "  -h,--help                   Print this help message and exit\n\n"
      "Examples:\n"
      "  tachless run arm.yaml --mode realtime --plant {} --dry-run\n",
      program.purpose, program.name, program.name);
  for (const DriverVerb& verb : program.verbs) {
    fmt::print("  {}\n      {}\n", verb.example, verb.meaning);
  }
  fmt::print(
      "The other options are those of tachless-plant. The page docs/{} has the keys of\n"
      "plant.driver, the first day with the arm, and the meaning of each message.\n"
      "Exit codes: 0 done, 1 a check failed, 2 bad usage or scenario, 3 a peer is lost,\n"
      "4 protocol violated, 5 protective stop, 130 interrupted.\n",
      program.page);
}

}  // namespace

int driver_main(const DriverProgram& program, int argc, const char* const* argv) {
  const std::vector<std::string> words(argv + 1, argv + argc);
  if (words.size() == 1 && (words[0] == "--help" || words[0] == "-h")) {
    print_help(program);
    return static_cast<int>(base::ExitCode::done);
  }
  const auto verb = std::ranges::find_if(program.verbs, [&](const DriverVerb& each) {
    return !words.empty() && words[0] == second_word(each.example);
  });
  if (verb == program.verbs.end()) return driver_program(argc, argv, program.make);
  base::start_logging(program.name, base::Verbosity::normal);
  try {
    verb->run({words.begin() + 1, words.end()});
    return static_cast<int>(base::ExitCode::done);
  } catch (const std::exception&) {
    return base::told_exception("the command line");
  }
}

DriverVerb emulate_verb(const std::string& program, const std::string& scenario, ServeRobot serve) {
  const std::string example = fmt::format("{} emulate {}", program, scenario);
  const auto run = [example, serve = std::move(serve)](const std::vector<std::string>& arguments) {
    if (arguments.empty() || arguments[0].starts_with('-')) {
      throw base::bad_usage("emulate: the scenario is missing; type: {} [KEY=VALUE ...]", example);
    }
    const scenario::Scenario emulated = scenario::load_scenario(
        session::find_scenario(arguments[0]), {arguments.begin() + 1, arguments.end()});
    const std::atomic<bool>& interrupted = base::catch_interruptions();
    // The thread is joined before `ends` goes, whether `serve` returns or throws.
    std::stop_source ends;
    const std::jthread watching([&](const std::stop_token& served) {
      while (!interrupted && !served.stop_requested()) {
        std::this_thread::sleep_for(std::chrono::milliseconds(50));
      }
      ends.request_stop();
    });
    serve(emulated, ends.get_token());
  };
  return {example, "Emulates the robot of a scenario until it is interrupted", run};
}

}  // namespace tachless::plant
