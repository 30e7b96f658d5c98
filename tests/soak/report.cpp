#include "tests/soak/report.h"

#include <fmt/core.h>
#include <unistd.h>

#include <algorithm>
#include <utility>
#include <vector>

#include "diagnostics/text.h"
#include "tests/support/process_facts.h"

namespace tachless::soak {

void Tally::add(const Outcome& outcome) {
  ++rounds;
  if (outcome.verdict.problems.empty()) ++held;
  hostile_datagrams += outcome.seen.hostile_datagrams;
  longest_end_s = std::max(longest_end_s, outcome.seen.end_s);
  const nlohmann::json& summary = outcome.verdict.summary;
  if (!summary.is_object()) return;
  ticks += summary.value("ticks", std::int64_t{0});
  resends += summary.value("resends", std::int64_t{0});
  missed_deadlines += summary.value("missed_deadlines", std::int64_t{0});
  longest_miss = std::max(longest_miss, summary.value("longest_miss", std::int64_t{0}));
  for (const auto& [reason, count] : summary.at("rejected").items()) {
    rejected += count.get<std::int64_t>();
  }
}

void Report::add(const Round& round, const Outcome& outcome, const std::filesystem::path& kept) {
  tallies_[static_cast<std::size_t>(round.fault)].add(outcome);
  const auto& [seen, verdict] = outcome;
  nlohmann::ordered_json entry = {{"round", rounds()},
                                  {"seed", round.seed},
                                  {"fault", name_of(round.fault)},
                                  {"scenario", round.scenario},
                                  {"what", describe(round)},
                                  {"held", verdict.problems.empty()},
                                  {"problems", verdict.problems},
                                  {"wall_s", seen.wall_s},
                                  {"end_s", seen.end_s},
                                  {"hostile_datagrams", seen.hostile_datagrams}};
  for (const char* key : {"ticks", "ticks_per_s", "resends", "rejected", "missed_deadlines",
                          "longest_miss", "missed_commands", "skipped_ticks", "fault"}) {
    const bool has = verdict.summary.is_object() && verdict.summary.contains(key);
    entry[std::string(key) == "fault" ? "said" : key] =
        has ? verdict.summary.at(key) : nlohmann::json();
  }
  for (const auto& [program, memory] : seen.memory) {
    entry["memory_kib"][program] = {{"early", memory.early}, {"peak", memory.peak}};
    peak_kib_[program] = std::max(peak_kib_[program], memory.peak);
    growth_kib_[program] = std::max(growth_kib_[program], memory.peak - memory.early);
  }
  if (!kept.empty()) entry["kept"] = kept.string();
  entries_.push_back(std::move(entry));
}

std::int64_t Report::held() const {
  std::int64_t held = 0;
  for (const Tally& tally : tallies_) held += tally.held;
  return held;
}

nlohmann::ordered_json Report::json(std::uint64_t first_seed, double elapsed_s) const {
  nlohmann::ordered_json faults;
  for (int i = 0; i < num_faults; ++i) {
    const Tally& tally = of(static_cast<Fault>(i));
    faults[name_of(static_cast<Fault>(i))] = {{"rounds", tally.rounds},
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
  return {{"seed", first_seed},
          {"minutes", elapsed_s / 60},
          {"rounds", rounds()},
          {"held", held()},
          {"faults", faults},
          {"memory_kib", memory},
          {"soak_kib", support::resident_kib(getpid()).value_or(0)},
          {"all", entries_}};
}

std::string Report::table(std::uint64_t first_seed, double elapsed_s) const {
  std::string text =
      fmt::format("  {:<14} {:>6} {:>6} {:>10} {:>9} {:>10} {:>10} {:>8}\n", "fault", "rounds",
                  "held", "ticks", "resends", "hostile", "rejected", "end [s]");
  for (int i = 0; i < num_faults; ++i) {
    const Tally& tally = of(static_cast<Fault>(i));
    if (tally.rounds == 0) continue;
    text += fmt::format("  {:<14} {:>6} {:>6} {:>10} {:>9} {:>10} {:>10} {:>8}\n",
                        name_of(static_cast<Fault>(i)), tally.rounds, tally.held, tally.ticks,
                        tally.resends, tally.hostile_datagrams, tally.rejected,
                        tally.longest_end_s > 0 ? fmt::format("{:.2f}", tally.longest_end_s) : "");
  }
  const Tally& realtime = of(Fault::realtime);
  if (realtime.rounds > 0) {
    text += fmt::format("\n  on the wall clock {} of {} deadlines missed, most in a row {}\n",
                        realtime.missed_deadlines, realtime.ticks, realtime.longest_miss);
  }
  std::vector<std::string> memory;
  for (const auto& [program, peak] : peak_kib_) {
    memory.push_back(fmt::format("{} {:.1f} MiB (grew by {} KiB)", program,
                                 static_cast<double>(peak) / 1024, growth_kib_.at(program)));
  }
  return text + fmt::format(
                    "\n  memory, most over all rounds: {}\n\n"
                    "{} rounds in {:.1f} min from seed {}, {} held\n",
                    diagnostics::joined(memory), rounds(), elapsed_s / 60, first_seed, held());
}

}  // namespace tachless::soak
