#include "tests/campaign/tally.h"

#include <fmt/core.h>

#include <algorithm>

namespace tachless::campaign {

void Tally::add(const Evidence& evidence, bool broken) {
  OfKind& of = kinds_[kind_of(evidence.plan)];
  ++of.rounds;
  of.ended_well += evidence.all_done() ? 1 : 0;
  of.broken += broken ? 1 : 0;
  of.hostile += evidence.num_hostile;
  of.longest_s = std::max(of.longest_s, evidence.wall_s);
}

std::int64_t Tally::rounds() const {
  std::int64_t all = 0;
  for (const auto& [kind, of] : kinds_) all += of.rounds;
  return all;
}

std::int64_t Tally::broken() const {
  std::int64_t all = 0;
  for (const auto& [kind, of] : kinds_) all += of.broken;
  return all;
}

std::string Tally::text() const {
  std::string text;
  for (const auto& [kind, of] : kinds_) {
    text += fmt::format(
        "{}: {} rounds, {} ended well, {} broken, {} hostile datagrams, longest {:.2f} s\n", kind,
        of.rounds, of.ended_well, of.broken, of.hostile, of.longest_s);
  }
  return text;
}

}  // namespace tachless::campaign
