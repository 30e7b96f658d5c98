// The campaign: TACHLESS_CAMPAIGN_ROUNDS rounds (200) from TACHLESS_CAMPAIGN_SEED (1) on. One round
// again: TACHLESS_CAMPAIGN_SEED=N TACHLESS_CAMPAIGN_ROUNDS=1.
#include <fmt/core.h>
#include <gtest/gtest.h>

#include <atomic>
#include <cstdlib>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "tests/campaign/invariants.h"
#include "tests/campaign/round.h"
#include "tests/campaign/tally.h"

namespace tachless::campaign {
namespace {

std::uint64_t number(const char* variable, std::uint64_t otherwise) {
  const char* text = std::getenv(variable);
  return text == nullptr ? otherwise : std::stoull(text);
}

class Campaign {
 public:
  Campaign(std::uint64_t first, std::uint64_t rounds) : next_(first), end_(first + rounds) {}

  void play_all() {
    // A round mostly waits: for its threads to meet, for its leaving, for somebody to be missed.
    std::vector<std::thread> workers(8);
    for (std::thread& worker : workers) {
      worker = std::thread([this] {
        for (auto seed = next_++; seed < end_; seed = next_++) add(play(plan_of(seed)));
      });
    }
    for (std::thread& worker : workers) worker.join();
  }

  void report() const { fmt::print("{}", tally_.text()); }

 private:
  void add(const Evidence& evidence) {
    const auto broken = violations(evidence);
    const std::lock_guard lock(mutex_);
    tally_.add(evidence, !broken.empty());
    if (tally_.rounds() % 500 == 0) fmt::print(stderr, "{} rounds\n", tally_.rounds());
    for (const std::string& each : broken) {
      ADD_FAILURE() << each << "\n  " << describe(evidence.plan) << "\n"
                    << evidence.result.complaints()
                    << "  again: TACHLESS_CAMPAIGN_SEED=" << evidence.plan.seed
                    << " TACHLESS_CAMPAIGN_ROUNDS=1";
    }
  }

  std::atomic<std::uint64_t> next_;
  std::uint64_t end_;
  std::mutex mutex_;
  Tally tally_;
};

TEST(TheCampaign, BreaksNoInvariant) {
  Campaign campaign(number("TACHLESS_CAMPAIGN_SEED", 1), number("TACHLESS_CAMPAIGN_ROUNDS", 200));
  campaign.play_all();
  campaign.report();
}

}  // namespace
}  // namespace tachless::campaign
