// Runs of `tachless run`, one after the other, each with another fault: does what
// docs/operations.md promises hold? Always in a private network namespace.

#include <fmt/core.h>

#include <CLI/CLI.hpp>
#include <atomic>
#include <chrono>
#include <exception>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <optional>
#include <string>
#include <system_error>

#include "diagnostics/failure.h"
#include "diagnostics/logging.h"
#include "diagnostics/text.h"
#include "launch/progress.h"
#include "process/this_process.h"
#include "tests/soak/attacks.h"
#include "tests/soak/plan.h"
#include "tests/soak/report.h"
#include "tests/soak/runner.h"

namespace tachless::soak {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

struct Options {
  double minutes = 0;
  std::int64_t rounds = 0;
  std::uint64_t seed = 1;
  Setting setting{.program = TACHLESS_BINARY_DIR "/bin/tachless",
                  .directory = "out/soak",
                  .scenarios = TACHLESS_SOURCE_DIR "/scenarios",
                  .num_ticks = 20'000};
  bool attacks = false;
  bool json = false;
  bool quiet = false;
};

class Soak {
 public:
  Soak(const Options& options, const std::atomic<bool>& interrupted)
      : options_(options), interrupted_(interrupted), runner_(options.setting, interrupted) {}

  diagnostics::ExitCode run() {
    std::uint64_t seed = options_.seed;
    while (!interrupted_ && !enough() && run_round(plan_round(seed))) ++seed;
    progress_.clear();
    runner_.clean_up();
    write();
    if (interrupted_ || cut_short_) return diagnostics::ExitCode::interrupted;
    return report_.held() == report_.rounds() ? diagnostics::ExitCode::done
                                              : diagnostics::ExitCode::check_said_no;
  }

 private:
  [[nodiscard]] double elapsed_s() const {
    return std::chrono::duration<double>(Clock::now() - begun_).count();
  }

  [[nodiscard]] bool enough() const {
    return (options_.minutes > 0 && elapsed_s() >= 60 * options_.minutes) ||
           (options_.rounds > 0 && report_.rounds() >= options_.rounds);
  }

  /// @return false when the user ended it
  bool run_round(const Round& round) {
    const std::int64_t number = report_.rounds() + 1;
    progress_.show(fmt::format("{:.1f} min, round {}, seed {}: {}, {}", elapsed_s() / 60, number,
                               round.seed, round.scenario, describe(round)));
    Outcome outcome;
    try {
      outcome = runner_.run(round);
    } catch (const diagnostics::Failure& failure) {
      if (failure.code() != diagnostics::ExitCode::interrupted) throw;
      cut_short_ = true;
      return false;
    }
    fs::path kept;
    if (!outcome.verdict.problems.empty()) {
      kept = options_.setting.directory / fmt::format("seed-{}", round.seed);
      fs::remove_all(kept);
      fs::rename(runner_.last(), kept);
    }
    report_.add(round, outcome, kept);
    progress_.clear();
    for (const std::string& problem : outcome.verdict.problems) {
      diagnostics::log_error(fmt::format(
          "round {} ({}, {}): {}; kept in {}; the same again: ./tachless soak --rounds 1 --seed {}",
          number, round.scenario, describe(round), problem, kept.string(), round.seed));
    }
    return true;
  }

  void write() const {
    const std::string json = report_.json(options_.seed, elapsed_s()).dump(2) + "\n";
    const fs::path path = options_.setting.directory / "soak.json";
    if (!(std::ofstream(path) << json)) {
      diagnostics::log_warning(fmt::format("cannot write {}", path.string()));
    }
    std::cout << (options_.json ? json
                                : fmt::format("{}  {}\n", report_.table(options_.seed, elapsed_s()),
                                              path.string()));
  }

  const Options& options_;
  const std::atomic<bool>& interrupted_;
  bool cut_short_ = false;  ///< Ctrl-C during a round, when `supervise` catches signals
  Clock::time_point begun_ = Clock::now();
  Runner runner_;
  Report report_;
  launch::Screen progress_{options_.quiet};
};

void declare(CLI::App& command, Options& options) {
  command.add_option("--minutes", options.minutes, "Begin rounds for so long")
      ->check(CLI::Range(0.01, 1e5));
  command.add_option("--rounds", options.rounds, "End after so many rounds")
      ->check(CLI::Range(std::int64_t{1}, std::int64_t{1'000'000'000}));
  command
      .add_option("--seed", options.seed,
                  "Of the first round; the next one's is one more. All of a round follows from its "
                  "seed")
      ->capture_default_str();
  command
      .add_option("--ticks", options.setting.num_ticks,
                  "Length of a lock-step run; on the wall clock a quarter of it")
      ->check(CLI::Range(std::int64_t{4'000}, std::int64_t{100'000'000}))
      ->capture_default_str();
  command
      .add_option("--growth-kib", options.setting.most_growth_kib,
                  "Largest growth of a process's memory that is no problem. Programs built with a "
                  "sanitizer hold freed memory back and need more")
      ->capture_default_str();
  command
      .add_option("--out", options.setting.directory,
                  "Where soak.json goes, and the files of each round that did not hold")
      ->capture_default_str();
  CLI::Option* attacks = command.add_flag(
      "--attacks", options.attacks,
      "Rounds of the fault campaign, with the four programs on the real bus, instead");
  command.add_flag("-q,--quiet", options.quiet, "No progress");
  command.add_flag("--json", options.json, "The outcome as JSON on stdout, instead of the table")
      ->excludes(attacks);
  command.footer(
      "Examples:\n"
      "  ./tachless soak --minutes 30\n"
      "  ./tachless soak --rounds 1 --seed 17\n"
      "  ./tachless soak --attacks --rounds 500\n"
      "Exit code 0 when all rounds held, 1 when one did not, 2 bad usage, 130 interrupted.");
}

diagnostics::ExitCode soak(int argc, const char* const* argv) {
  CLI::App command("Runs and faults by turns, for long: does what is promised hold?", "soak");
  Options options;
  declare(command, options);
  try {
    command.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) {
      command.exit(error, std::cout, std::cerr);
      return diagnostics::ExitCode::done;
    }
    throw diagnostics::Failure(diagnostics::ExitCode::bad_usage,
                               fmt::format("{}; see ./tachless soak --help", error.what()));
  }
  if (options.minutes == 0 && options.rounds == 0) {
    throw diagnostics::Failure(diagnostics::ExitCode::bad_usage,
                               "say how long, for example --minutes 30 or --rounds 9");
  }
  const std::atomic<bool>& interrupted = process::catch_interruptions();
  try {
    process::enter_private_network();
  } catch (const std::system_error& error) {
    throw diagnostics::Failure(diagnostics::ExitCode::bad_usage,
                               fmt::format("cannot isolate the soak: {}", error.what()));
  }
  if (options.attacks) {
    return play_attacks({.first_seed = options.seed,
                         .rounds = options.rounds,
                         .minutes = options.minutes,
                         .directory = options.setting.directory,
                         .quiet = options.quiet},
                        interrupted);
  }
  return Soak(options, interrupted).run();
}

}  // namespace
}  // namespace tachless::soak

int main(int argc, char** argv) {
  using namespace tachless;
  diagnostics::start_logging("soak", diagnostics::Verbosity::normal);
  try {
    return static_cast<int>(soak::soak(argc, argv));
  } catch (const diagnostics::Failure& failure) {
    diagnostics::log_error(failure.what());
    return static_cast<int>(failure.code());
  } catch (const std::exception& error) {
    diagnostics::log_error(fmt::format("internal error: {}", diagnostics::one_line(error.what())));
    return static_cast<int>(diagnostics::ExitCode::protocol_violated);
  }
}
