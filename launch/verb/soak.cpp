#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <system_error>
#include <vector>

#include "diagnostics/logging.h"
#include "launch/soak_plan.h"
#include "launch/soak_round.h"
#include "launch/verb.h"
#include "process/interruption.h"
#include "process/isolate.h"
#include "process/process_tree.h"

namespace tachless::launch::verb {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

struct Options {
  double minutes = 0;
  std::int64_t rounds = 0;
  std::uint64_t seed = 1;
  std::int64_t num_ticks = 20'000;
  fs::path out = "out/soak";
  bool json = false;
  bool quiet = false;
};

/// What is told of all rounds with one fault.
struct Tally {
  std::int64_t rounds = 0;
  std::int64_t held = 0;
  std::int64_t ticks = 0;
  std::int64_t resends = 0;
  std::int64_t rejected = 0;
  std::int64_t hostile_datagrams = 0;
  std::int64_t missed_deadlines = 0;
  std::int64_t longest_miss = 0;
  double longest_end_s = 0;

  void add(const SoakOutcome& outcome) {
    ++rounds;
    if (outcome.problems.empty()) ++held;
    hostile_datagrams += outcome.hostile_datagrams;
    longest_end_s = std::max(longest_end_s, outcome.end_s);
    if (!outcome.summary.is_object()) return;
    const nlohmann::json& summary = outcome.summary;
    ticks += summary.value("ticks", std::int64_t{0});
    resends += summary.value("resends", std::int64_t{0});
    missed_deadlines += summary.value("missed_deadlines", std::int64_t{0});
    longest_miss = std::max(longest_miss, summary.value("longest_miss", std::int64_t{0}));
    for (const auto& [reason, count] : summary.at("rejected").items()) {
      rejected += count.get<std::int64_t>();
    }
  }
};

class Report {
 public:
  explicit Report(const Options& options) : options_(options) {}

  void begin_round(const SoakRound& round, double elapsed_s) {
    if (options_.quiet) return;
    const std::int64_t number = rounds() + 1;
    char text[256];
    std::snprintf(text, sizeof text, "%.1f min, round %lld, seed %llu: %s, %s", elapsed_s / 60,
                  static_cast<long long>(number), static_cast<unsigned long long>(round.seed),
                  round.scenario.c_str(), describe(round).c_str());
    std::cerr << (terminal_ ? "\r\033[K" : "") << text << (terminal_ ? "" : "\n") << std::flush;
  }

  void add(const SoakRound& round, const SoakOutcome& outcome, const fs::path& kept) {
    tallies_[static_cast<std::size_t>(round.fault)].add(outcome);
    nlohmann::ordered_json entry = {{"round", rounds()},
                                    {"seed", round.seed},
                                    {"fault", name_of(round.fault)},
                                    {"scenario", round.scenario},
                                    {"what", describe(round)},
                                    {"held", outcome.problems.empty()},
                                    {"problems", outcome.problems},
                                    {"wall_s", outcome.wall_s},
                                    {"end_s", outcome.end_s},
                                    {"hostile_datagrams", outcome.hostile_datagrams}};
    for (const char* key : {"ticks", "ticks_per_s", "resends", "rejected", "missed_deadlines",
                            "longest_miss", "missed_commands", "skipped_ticks", "fault"}) {
      const bool has = outcome.summary.is_object() && outcome.summary.contains(key);
      entry[std::string(key) == "fault" ? "said" : key] =
          has ? outcome.summary.at(key) : nlohmann::json();
    }
    for (const auto& [program, memory] : outcome.memory) {
      entry["memory_kib"][program] = {{"early", memory.early}, {"peak", memory.peak}};
      peak_kib_[program] = std::max(peak_kib_[program], memory.peak);
      growth_kib_[program] = std::max(growth_kib_[program], memory.peak - memory.early);
    }
    if (!kept.empty()) entry["kept"] = kept.string();
    entries_.push_back(std::move(entry));
    clear();
    for (const std::string& problem : outcome.problems) {
      diagnostics::log_error("round " + std::to_string(rounds()) + " (" + round.scenario + ", " +
                             describe(round) + "): " + problem + "; kept in " + kept.string() +
                             "; the same again: tachless soak --rounds 1 --seed " +
                             std::to_string(round.seed));
    }
  }

  void clear() const {
    if (terminal_ && !options_.quiet) std::cerr << "\r\033[K" << std::flush;
  }

  [[nodiscard]] std::int64_t rounds() const { return std::ssize(entries_); }
  [[nodiscard]] std::int64_t held() const {
    std::int64_t held = 0;
    for (const Tally& tally : tallies_) held += tally.held;
    return held;
  }

  [[nodiscard]] nlohmann::ordered_json json(double elapsed_s) const {
    nlohmann::ordered_json faults;
    for (int i = 0; i < num_soak_faults; ++i) {
      const Tally& tally = tallies_[static_cast<std::size_t>(i)];
      faults[name_of(static_cast<SoakFault>(i))] = {{"rounds", tally.rounds},
                                                    {"held", tally.held},
                                                    {"ticks", tally.ticks},
                                                    {"resends", tally.resends},
                                                    {"rejected", tally.rejected},
                                                    {"hostile_datagrams", tally.hostile_datagrams},
                                                    {"missed_deadlines", tally.missed_deadlines},
                                                    {"longest_miss", tally.longest_miss},
                                                    {"longest_end_s", tally.longest_end_s}};
    }
    nlohmann::ordered_json memory;
    for (const auto& [program, peak] : peak_kib_) {
      memory[program] = {{"peak", peak}, {"most_growth", growth_kib_.at(program)}};
    }
    return {{"seed", options_.seed}, {"minutes", elapsed_s / 60},
            {"rounds", rounds()},    {"held", held()},
            {"faults", faults},      {"memory_kib", memory},
            {"soak_kib", own_kib()}, {"all", entries_}};
  }

  [[nodiscard]] std::string table(double elapsed_s) const {
    char row[256];
    std::snprintf(row, sizeof row, "  %-14s %6s %6s %10s %9s %10s %10s %8s\n", "fault", "rounds",
                  "held", "ticks", "resends", "hostile", "rejected", "end [s]");
    std::string text = row;
    for (int i = 0; i < num_soak_faults; ++i) {
      const Tally& tally = tallies_[static_cast<std::size_t>(i)];
      if (tally.rounds == 0) continue;
      std::string end = "";
      if (tally.longest_end_s > 0) {
        std::snprintf(row, sizeof row, "%.2f", tally.longest_end_s);
        end = row;
      }
      std::snprintf(row, sizeof row, "  %-14s %6lld %6lld %10lld %9lld %10lld %10lld %8s\n",
                    name_of(static_cast<SoakFault>(i)).c_str(),
                    static_cast<long long>(tally.rounds), static_cast<long long>(tally.held),
                    static_cast<long long>(tally.ticks), static_cast<long long>(tally.resends),
                    static_cast<long long>(tally.hostile_datagrams),
                    static_cast<long long>(tally.rejected), end.c_str());
      text += row;
    }
    const Tally& realtime = tallies_[static_cast<std::size_t>(SoakFault::realtime)];
    if (realtime.rounds > 0) {
      std::snprintf(row, sizeof row,
                    "\n  on the wall clock %lld of %lld deadlines missed, most in a row %lld\n",
                    static_cast<long long>(realtime.missed_deadlines),
                    static_cast<long long>(realtime.ticks),
                    static_cast<long long>(realtime.longest_miss));
      text += row;
    }
    text += "\n  memory, most over all rounds: ";
    for (const auto& [program, peak] : peak_kib_) {
      std::snprintf(row, sizeof row, "%s%s %.1f MiB (grew by %lld KiB)",
                    program == peak_kib_.begin()->first ? "" : ", ", program.c_str(),
                    static_cast<double>(peak) / 1024,
                    static_cast<long long>(growth_kib_.at(program)));
      text += row;
    }
    std::snprintf(row, sizeof row, "\n\n%lld rounds in %.1f min from seed %llu, %lld held\n",
                  static_cast<long long>(rounds()), elapsed_s / 60,
                  static_cast<unsigned long long>(options_.seed), static_cast<long long>(held()));
    return text + row;
  }

 private:
  static std::int64_t own_kib() { return process::resident_kib(getpid()).value_or(0); }

  const Options& options_;
  bool terminal_ = isatty(STDERR_FILENO) == 1;
  std::array<Tally, num_soak_faults> tallies_;
  std::map<std::string, std::int64_t> peak_kib_, growth_kib_;
  nlohmann::ordered_json entries_ = nlohmann::ordered_json::array();
};

diagnostics::ExitCode soak_rounds(const Options& options) {
  if (options.minutes == 0 && options.rounds == 0) {
    throw diagnostics::Failure(diagnostics::ExitCode::bad_usage,
                               "soak: say how long, for example --minutes 30 or --rounds 9");
  }
  const std::atomic<bool>& interrupted = process::catch_interruptions();
  try {
    process::enter_private_network();
  } catch (const std::system_error& error) {
    throw diagnostics::Failure(diagnostics::ExitCode::bad_usage,
                               std::string("cannot isolate the soak: ") + error.what());
  }
  SoakRunner runner(fs::read_symlink("/proc/self/exe"), options.out,
                    TACHLESS_SOURCE_DIR "/scenarios", options.num_ticks, interrupted);
  Report report(options);
  const auto begun = Clock::now();
  const auto elapsed_s = [&] {
    return std::chrono::duration<double>(Clock::now() - begun).count();
  };
  bool cut_short = false;
  for (std::uint64_t seed = options.seed; !interrupted; ++seed) {
    if (options.minutes > 0 && elapsed_s() >= 60 * options.minutes) break;
    if (options.rounds > 0 && report.rounds() >= options.rounds) break;
    const SoakRound round = plan_soak_round(seed);
    report.begin_round(round, elapsed_s());
    SoakOutcome outcome;
    try {
      outcome = runner.play(round);
    } catch (const diagnostics::Failure& failure) {
      if (failure.code() != diagnostics::ExitCode::interrupted) throw;
      cut_short = true;
      break;
    }
    fs::path kept;
    if (!outcome.problems.empty()) {
      kept = options.out / ("seed-" + std::to_string(seed));
      fs::remove_all(kept);
      fs::rename(runner.last(), kept);
    }
    report.add(round, outcome, kept);
  }
  report.clear();
  runner.clean_up();
  const nlohmann::ordered_json json = report.json(elapsed_s());
  const fs::path json_path = options.out / "soak.json";
  if (!(std::ofstream(json_path) << json.dump(2) << "\n")) {
    diagnostics::log_warning("cannot write " + json_path.string());
  }
  if (options.json) {
    std::cout << json.dump(2) << "\n";
  } else {
    std::cout << report.table(elapsed_s()) << "  " << json_path.string() << "\n";
  }
  if (interrupted || cut_short) return diagnostics::ExitCode::interrupted;
  return report.held() == report.rounds() ? diagnostics::ExitCode::done
                                          : diagnostics::ExitCode::check_said_no;
}

Verb::Action declare(CLI::App& command) {
  auto options = std::make_shared<Options>();
  command.add_option("--minutes", options->minutes, "Begin rounds for so long")
      ->check(CLI::Range(0.01, 1e5));
  command.add_option("--rounds", options->rounds, "End after so many rounds")
      ->check(CLI::Range(std::int64_t{1}, std::int64_t{1'000'000'000}));
  command
      .add_option("--seed", options->seed,
                  "Of the first round; the next one's is one more. All of a round follows from its "
                  "seed")
      ->capture_default_str();
  command
      .add_option("--ticks", options->num_ticks,
                  "Length of a lock-step run; on the wall clock "
                  "a quarter of it")
      ->check(CLI::Range(std::int64_t{4'000}, std::int64_t{100'000'000}))
      ->capture_default_str();
  command
      .add_option("--out", options->out,
                  "Where soak.json goes, and the files of each round that did not hold")
      ->capture_default_str();
  command.add_flag("-q,--quiet", options->quiet, "No progress");
  command.add_flag("--json", options->json, "The outcome as JSON on stdout, instead of the table");
  return [options] { return soak_rounds(*options); };
}

}  // namespace

extern const Verb soak;
const Verb soak = {"soak", "Runs and faults by turns, for long: does what is promised hold?",
                   "  tachless soak --minutes 30\n"
                   "  tachless soak --rounds 1 --seed 17\n"
                   "Always in a private network namespace. Exit code 1 when a round did not hold.",
                   declare};

}  // namespace tachless::launch::verb
