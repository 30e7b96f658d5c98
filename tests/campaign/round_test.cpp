// The campaign in one process: 100 rounds, or TACHLESS_CAMPAIGN_ROUNDS.
#include "tests/campaign/campaign.h"

namespace tachless::campaign {
namespace {

TEST(TheCampaign, BreaksNoInvariant) {
  // A round mostly waits: for its threads to join, for its end, or for a silent member.
  Campaign::run([](std::uint64_t seed) { return play(plan_of(seed)); }, 100, 8);
}

}  // namespace
}  // namespace tachless::campaign
