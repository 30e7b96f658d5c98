#include "tests/soak/attacks.h"

#include <fmt/core.h>

#include <chrono>
#include <iostream>
#include <string>
#include <vector>

#include "launch/progress.h"
#include "tests/campaign/invariants.h"
#include "tests/campaign/tally.h"
#include "tests/soak/attack_round.h"
#include "tests/soak/packet_loss.h"
#include "tests/soak/spec.h"

namespace tachless::soak {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;
using diagnostics::ExitCode;

void tell(const campaign::Evidence& evidence, const std::vector<std::string>& broken,
          const fs::path& kept) {
  for (const std::string& each : broken) {
    std::cerr << fmt::format(
        "soak: {} ({}); kept in {}; the same again: ./tachless soak --attacks --rounds 1 --seed "
        "{}\n",
        each, describe(evidence.plan), kept.string(), evidence.plan.seed);
  }
  std::cerr << evidence.result.complaints() << std::flush;
}

}  // namespace

ExitCode play_attacks(const Attacks& attacks, const std::atomic<bool>& interrupted) {
  make_directory(attacks.directory);
  PacketLoss::require();
  launch::Screen progress(attacks.quiet);
  const auto begun = Clock::now();
  const auto minutes = [&] {
    return std::chrono::duration<double, std::ratio<60>>(Clock::now() - begun).count();
  };
  const fs::path last = attacks.directory / "attack-round";
  campaign::Tally tally;
  const auto enough = [&] {
    return (attacks.rounds > 0 && tally.rounds() >= attacks.rounds) ||
           (attacks.minutes > 0 && minutes() >= attacks.minutes);
  };
  for (std::uint64_t seed = attacks.first_seed; !interrupted && !enough(); ++seed) {
    const campaign::Plan plan = on_the_real_bus(campaign::plan_of(seed));
    progress.show(fmt::format("{:.1f} min, round {}, seed {}: {}", minutes(), tally.rounds() + 1,
                              seed, describe(plan)));
    const campaign::Evidence evidence = attack(plan, last);
    progress.clear();
    if (interrupted) break;  // perhaps by a Ctrl-C that the programs have heard too
    const auto broken = campaign::violations(evidence);
    tally.add(evidence, !broken.empty());
    if (broken.empty()) continue;
    const fs::path kept = attacks.directory / fmt::format("attack-{}", seed);
    fs::remove_all(kept);
    fs::rename(last, kept);
    tell(evidence, broken, kept);
  }
  fs::remove_all(last);
  std::cout << fmt::format("{}\n{} rounds in {:.1f} min from seed {}, {} broke an invariant\n",
                           tally.text(), tally.rounds(), minutes(), attacks.first_seed,
                           tally.broken());
  if (interrupted) return ExitCode::interrupted;
  return tally.broken() == 0 ? ExitCode::done : ExitCode::check_said_no;
}

}  // namespace tachless::soak
