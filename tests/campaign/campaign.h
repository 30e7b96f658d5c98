#pragma once

#include <fmt/core.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <cstdlib>
#include <functional>
#include <map>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "tests/campaign/invariants.h"
#include "tests/campaign/round.h"

namespace tachless::campaign {

/// Plays TACHLESS_CAMPAIGN_ROUNDS rounds from seed TACHLESS_CAMPAIGN_SEED (1) on and checks the
/// invariants of each. It prints a table of the kinds of rounds to stdout.
class Campaign {
 public:
  using Play = std::function<Evidence(std::uint64_t seed)>;

  /// @param rounds default of the variable  @param workers number of rounds at the same time
  static void run(const Play& play, std::uint64_t rounds, int workers) {
    Campaign campaign;
    std::atomic<std::uint64_t> next = number("TACHLESS_CAMPAIGN_SEED", 1);
    const std::uint64_t end = next + number("TACHLESS_CAMPAIGN_ROUNDS", rounds);
    std::vector<std::thread> threads(static_cast<std::size_t>(workers));
    for (std::thread& thread : threads) {
      thread = std::thread([&] {
        for (auto seed = next++; seed < end; seed = next++) campaign.add(play(seed));
      });
    }
    for (std::thread& thread : threads) thread.join();
    for (const auto& [kind, of] : campaign.kinds_) {
      fmt::print(
          "{}: {} rounds, {} ended well, {} broken, {} hostile datagrams, longest {:.2f} s\n", kind,
          of.rounds, of.ended_well, of.broken, of.hostile, of.longest_s);
    }
  }

 private:
  struct OfKind {
    std::int64_t rounds = 0, ended_well = 0, broken = 0, hostile = 0;
    double longest_s = 0;
  };

  static std::uint64_t number(const char* variable, std::uint64_t otherwise) {
    const char* text = std::getenv(variable);
    return text == nullptr ? otherwise : std::stoull(text);
  }

  void add(const Evidence& evidence) {
    const auto broken = violations(evidence);
    const std::lock_guard lock(mutex_);
    OfKind& of = kinds_[kind_of(evidence.plan)];
    ++of.rounds;
    of.ended_well += evidence.all_done() ? 1 : 0;
    of.broken += broken.empty() ? 0 : 1;
    of.hostile += evidence.num_hostile;
    of.longest_s = std::max(of.longest_s, evidence.wall_s);
    for (const std::string& each : broken) {
      ADD_FAILURE() << each << "\n  " << describe(evidence.plan) << "\n"
                    << evidence.result.complaints()
                    << "  again: TACHLESS_CAMPAIGN_SEED=" << evidence.plan.seed
                    << " TACHLESS_CAMPAIGN_ROUNDS=1";
    }
  }

  std::mutex mutex_;
  std::map<std::string, OfKind> kinds_;
};

}  // namespace tachless::campaign
