#include "tests/campaign/plan.h"

#include <fmt/core.h>

#include <array>
#include <cmath>
#include <random>
#include <string_view>

namespace tachless::campaign {
namespace {

constexpr std::array<std::string_view, 4> mishaps = {"kill", "stop", "interrupt", "failing bus"};
constexpr std::array<std::string_view, 3> paces = {"lockstep", "realtime", "long realtime"};

/// Returns the next step of the plan's seed. std::…_distribution would differ between machines.
class Draw {
 public:
  explicit Draw(std::uint64_t seed) : random_(seed) {}
  std::uint64_t below(std::uint64_t bound) { return random_() % bound; }
  double share() { return static_cast<double>(random_() >> 11) * 0x1p-53; }
  bool chance(double probability) { return share() < probability; }

 private:
  std::mt19937_64 random_;
};

Hostility hostility_of(Draw& draw) {
  Hostility plan;
  plan.replays = draw.chance(0.5);
  plan.recordings = draw.chance(0.5);
  plan.forges = draw.chance(0.4);
  plan.damages = draw.chance(0.3);
  plan.contradicts = draw.chance(0.3);
  plan.acknowledges = draw.chance(0.15);
  plan.rate = std::pow(10, -3.5 * draw.share());
  plan.from = draw.chance(0.3) ? 0 : static_cast<int>(draw.below(1800));
  if (draw.chance(0.2)) plan.races = std::pow(10, -3 * draw.share());
  if (draw.chance(0.5)) plan.drops = 0.3 * draw.share();
  const auto role = static_cast<messages::Role>(draw.below(messages::num_roles));
  plan.sender =
      draw.chance(0.7) ? "an outsider" : std::string(messages::name(role)) + "'s endpoint";
  if (plan.acknowledges) plan.sender = "logger's endpoint";
  return plan;
}

}  // namespace

bool Plan::must_end_well() const {
  if (mishap && mishap->kind != Mishap::Kind::stop) return false;
  if (keyed || !hostility) return true;
  // Without a key, copies of this run's messages change nothing, with two exceptions: the address
  // is false, or the original was lost and the copy counts as the member's.
  return network.loss == 0 && !hostility->lies() && !hostility->recordings &&
         hostility->sender == "an outsider";
}

Plan plan_of(std::uint64_t seed) {
  Draw draw(seed);
  Plan plan;
  plan.seed = seed;
  plan.keyed = draw.chance(0.5);
  if (draw.chance(0.08)) plan.pace = Pace::realtime;
  if (draw.chance(0.9)) plan.hostility = hostility_of(draw);
  if (draw.chance(0.25)) {
    plan.mishap = Mishap{static_cast<Mishap::Kind>(draw.below(3)),
                         static_cast<messages::Role>(draw.below(messages::num_roles)),
                         static_cast<int>(draw.below(900)), static_cast<int>(draw.below(400))};
    if (!plan.lockstep() && plan.mishap->kind != Mishap::Kind::stop) {
      plan.pace = Pace::realtime_long;
    }
  }
  // Realtime repeats nothing, so a lost message is missing in the log.
  if (!plan.lockstep() && plan.hostility) plan.hostility->drops = 0;
  if (plan.lockstep() && draw.chance(0.5)) {
    plan.network = {.loss = 0.3 * draw.share(),
                    .duplication = 0.1 * draw.share(),
                    .reordering = 0.2 * draw.share(),
                    .seed = seed};
  }
  // These are drawn last, so that the other parts of a round stay the same for a given seed.
  if (plan.hostility) {
    plan.hostility->announces = draw.chance(0.15);
    plan.hostility->names = draw.chance(0.1);
    plan.hostility->floods = draw.chance(0.1);
  }
  if (plan.mishap && plan.mishap->kind != Mishap::Kind::stop && draw.chance(0.2)) {
    plan.mishap->kind = Mishap::Kind::fail;
  }
  return plan;
}

std::string kind_of(const Plan& plan) {
  return fmt::format(
      "{} {}{}{}", plan.keyed ? "keyed" : "plain", paces.at(static_cast<std::size_t>(plan.pace)),
      !plan.hostility          ? ""
      : plan.hostility->lies() ? ", lies"
                               : ", replays",
      plan.mishap ? fmt::format(", {}", mishaps.at(static_cast<std::size_t>(plan.mishap->kind)))
                  : "");
}

std::string describe(const Plan& plan) {
  std::string text = kind_of(plan);
  const auto& network = plan.network;
  if (network.loss > 0) {
    text += fmt::format(", loss {:.2f} duplication {:.2f} reordering {:.2f}", network.loss,
                        network.duplication, network.reordering);
  }
  if (const auto& hostile = plan.hostility) {
    text += fmt::format(", {} from its {}th datagram with {:.4f}:", hostile->sender, hostile->from,
                        hostile->rate);
    if (hostile->replays) text += " replays";
    if (hostile->recordings) text += " recordings";
    if (hostile->forges) text += " forges";
    if (hostile->damages) text += " damages";
    if (hostile->contradicts) text += " contradicts";
    if (hostile->acknowledges) text += " acknowledges";
    if (hostile->announces) text += " announces";
    if (hostile->names) text += " names";
    if (hostile->floods) text += " floods";
    if (hostile->races > 0) text += fmt::format(" races {:.3f}", hostile->races);
    if (hostile->races > 0) text += fmt::format(" drops {:.2f}", hostile->drops);
  }
  if (plan.mishap) {
    text += fmt::format(", the {} at its {}th datagram ({} ms)", messages::name(plan.mishap->role),
                        plan.mishap->at, plan.mishap->stop_ms);
  }
  return text;
}

}  // namespace tachless::campaign
