#include "tests/soak/plan.h"

#include <fmt/core.h>

#include <array>
#include <cmath>
#include <random>

namespace tachless::soak {
namespace {

constexpr std::array lockstep_scenarios = {"paper_rigid",         "practical_rigid",
                                           "paper_flexible",      "practical_flexible",
                                           "iiwa_point_to_point", "flexible_regulation"};
// Stable with the tick of delay that this mode has.
constexpr std::array realtime_scenarios = {"practical_rigid", "iiwa_point_to_point", "regulation"};

}  // namespace

Round plan_round(std::uint64_t seed) {
  Round round;
  round.seed = seed;
  round.fault = static_cast<Fault>(seed % num_faults);
  std::mt19937_64 random(seed);
  // Everything is drawn for every fault, so that none changes the others' draws. Remainders, not
  // distributions: those are each library's own.
  const auto scenario = random();
  round.scenario = round.realtime() ? realtime_scenarios[scenario % realtime_scenarios.size()]
                                    : lockstep_scenarios[scenario % lockstep_scenarios.size()];
  round.moment = 0.1 + 0.01 * static_cast<double>(random() % 41);
  round.loss_percent = 1 + static_cast<int>(random() % 15);
  round.victim = static_cast<loop::Role>(random() % loop::num_roles);
  if (round.fault == Fault::restart) round.victim = loop::Role::controller;
  round.pause = std::chrono::milliseconds(50 + random() % 951);
  return round;
}

std::string name_of(Fault fault) {
  switch (fault) {
    case Fault::none:
      return "clean";
    case Fault::hostile:
      return "hostile";
    case Fault::loss:
      return "loss";
    case Fault::kill:
      return "kill";
    case Fault::realtime:
      return "realtime";
    case Fault::key:
      return "key";
    case Fault::pause:
      return "pause";
    case Fault::interrupt:
      return "interrupt";
    case Fault::restart:
      return "restart";
    case Fault::realtime_kill:
      return "realtime-kill";
  }
  return "";
}

std::string describe(const Round& round) {
  const std::string_view victim = loop::name(round.victim);
  const std::string when = fmt::format(" after {} % of the run", std::lround(100 * round.moment));
  switch (round.fault) {
    case Fault::none:
      return "left alone";
    case Fault::hostile:
      return "among hostile datagrams";
    case Fault::loss:
      return fmt::format("{} % of all packets lost", round.loss_percent);
    case Fault::kill:
      return fmt::format("{} killed{}", victim, when);
    case Fault::realtime:
      return "on the wall clock";
    case Fault::key:
      return "on a bus with a key";
    case Fault::pause:
      return fmt::format("{} stopped for {} ms{}", victim, round.pause.count(), when);
    case Fault::interrupt:
      return "Ctrl-C" + when;
    case Fault::restart:
      return "controller killed and restarted" + when;
    case Fault::realtime_kill:
      return fmt::format("on the wall clock, {} killed{}", victim, when);
  }
  return "";
}

}  // namespace tachless::soak
