#include "launch/soak_plan.h"

#include <array>
#include <cmath>
#include <random>

namespace tachless::launch {
namespace {

constexpr std::array lockstep_scenarios = {"paper_rigid",         "practical_rigid",
                                           "paper_flexible",      "practical_flexible",
                                           "iiwa_point_to_point", "flexible_regulation"};
// Stable with the tick of delay that this mode has.
constexpr std::array realtime_scenarios = {"practical_rigid", "iiwa_point_to_point", "regulation"};

}  // namespace

SoakRound plan_soak_round(std::uint64_t seed) {
  SoakRound round;
  round.seed = seed;
  round.fault = static_cast<SoakFault>(seed % num_soak_faults);
  std::mt19937_64 random(seed);
  // Everything is drawn for every fault, so that none changes the others' draws. Remainders, not
  // distributions: those are each library's own.
  const auto scenario = random();
  round.scenario = round.realtime() ? realtime_scenarios[scenario % realtime_scenarios.size()]
                                    : lockstep_scenarios[scenario % lockstep_scenarios.size()];
  round.moment = 0.1 + 0.01 * static_cast<double>(random() % 41);
  round.loss_percent = 1 + static_cast<int>(random() % 15);
  round.victim = static_cast<loop::Role>(random() % loop::num_roles);
  if (round.fault == SoakFault::restart) round.victim = loop::Role::controller;
  round.pause = std::chrono::milliseconds(50 + random() % 951);
  return round;
}

std::string name_of(SoakFault fault) {
  switch (fault) {
    case SoakFault::none:
      return "clean";
    case SoakFault::storm:
      return "storm";
    case SoakFault::loss:
      return "loss";
    case SoakFault::kill:
      return "kill";
    case SoakFault::realtime:
      return "realtime";
    case SoakFault::key:
      return "key";
    case SoakFault::pause:
      return "pause";
    case SoakFault::interrupt:
      return "interrupt";
    case SoakFault::restart:
      return "restart";
    case SoakFault::realtime_kill:
      return "realtime-kill";
  }
  return "";
}

std::string describe(const SoakRound& round) {
  const std::string victim(loop::name(round.victim));
  const std::string when =
      " after " + std::to_string(std::lround(100 * round.moment)) + " % of the run";
  switch (round.fault) {
    case SoakFault::none:
      return "left alone";
    case SoakFault::storm:
      return "under a storm of hostile datagrams";
    case SoakFault::loss:
      return std::to_string(round.loss_percent) + " % of all packets lost";
    case SoakFault::kill:
      return victim + " killed" + when;
    case SoakFault::realtime:
      return "on the wall clock";
    case SoakFault::key:
      return "on a bus with a key";
    case SoakFault::pause:
      return victim + " stopped for " + std::to_string(round.pause.count()) + " ms" + when;
    case SoakFault::interrupt:
      return "Ctrl-C" + when;
    case SoakFault::restart:
      return "controller killed and restarted" + when;
    case SoakFault::realtime_kill:
      return "on the wall clock, " + victim + " killed" + when;
  }
  return "";
}

}  // namespace tachless::launch
