// The campaign with the four programs on the real bus: 10 rounds, or TACHLESS_CAMPAIGN_ROUNDS. The
// rounds run one after the other, because the packet loss affects the whole network.
#include "tests/campaign/programs.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>

#include "tests/campaign/attacker.h"
#include "tests/campaign/campaign.h"
#include "tests/campaign/impostor.h"
#include "tests/support/private_network.h"
#include "tests/support/process_facts.h"
#include "tests/support/sanitizer.h"
#include "tests/system/four_programs.h"

namespace tachless::campaign {
namespace {

TEST(TheCampaign, BreaksNoInvariantWithTheRealPrograms) {
  const TemporaryDirectory directory;
  Campaign::run(
      [&](std::uint64_t seed) {
        return play_with_programs(on_the_real_bus(plan_of(seed)), directory / "round");
      },
      10, 1);
}

/// A run of 20,000 ticks. No process gives up, because a flood can delay announcements on a busy
/// machine.
struct LongRun : system_test::FourPrograms {
  LongRun() : FourPrograms("practical_rigid.yaml") {
    settings = {"--set", "loop.duration_s=20", "--set", "loop.give_up_s=60"};
  }
  std::map<std::string, std::int64_t> resident_kib() {
    std::map<std::string, std::int64_t> result;
    for (const char* role : system_test::roles) {
      result[role] = support::resident_kib((*this)[role].pid()).value_or(0);
    }
    return result;
  }
};

TEST(AFlood, OfGarbageAndCopiesChangesNeitherTheLogNorTheMemory) {
  LongRun clean;
  clean.start_all();
  clean.expect_all_done();
  LongRun run;
  Hostility plan;
  plan.replays = plan.floods = true;
  plan.rate = 0.5;
  plan.from = 3'000;  // in datagrams; by then all processes have touched the memory that they need
  std::map<std::string, std::int64_t> before, after;
  Lies lies;
  const std::vector<Sent> nothing;
  {
    std::atomic<std::size_t> received = 0;
    Attacker attacker(std::make_unique<Impostor>(""), plan, 5, nothing, lies,
                      [&](std::size_t count) { received = count; });
    run.start_all();
    const auto until = base::Clock::now() + std::chrono::seconds(120);
    const auto wait_for = [&](std::size_t count) {
      while (received < count && base::Clock::now() < until && run["plant"].running()) {
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
      }
    };
    wait_for(3'000);
    before = run.resident_kib();
    wait_for(60'000);  // half of the run
    after = run.resident_kib();
    run.expect_all_done();
    attacker.stop();
    EXPECT_GT(attacker.num_sent(), 10'000);
  }
  EXPECT_TRUE(contents(run.log_path()) == contents(clean.log_path()));
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
  // A sanitizer delays the release of freed memory.
  for (const char* role : system_test::roles) {
    EXPECT_GT(before[role], 0) << role;
    EXPECT_LE(after[role] - before[role], 1024) << role << ": growth [KiB]";
  }
#endif
}

}  // namespace
}  // namespace tachless::campaign
