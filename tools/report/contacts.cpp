#include "report/contacts.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <vector>

#include "base/text.h"

namespace tachless::report {
namespace {

/// Returns the joints' numbers from 1.
std::vector<std::size_t> numbers_of(const std::array<bool, max_joints>& joints) {
  std::vector<std::size_t> numbers;
  for (std::size_t i = 0; i < joints.size(); ++i) {
    if (joints[i]) numbers.push_back(i + 1);
  }
  return numbers;
}

nlohmann::ordered_json pair_json(const Contacts::Pair& pair) {
  if (pair.geoms.empty()) return {};
  return {{"time_s", pair.time_s}, {"geoms", pair.geoms}, {"force_N", pair.force}};
}

}  // namespace

void Contacts::add(const messages::TickRecord& record, double t_s) {
  if (!record.contact) return;
  simulator = base::printable(record.contact->simulator);
  if (record.contact->geoms.empty()) return;
  const Pair pair{t_s, base::printable(record.contact->geoms), record.contact->force};
  if (ticks++ == 0) first = pair;
  if (pair.force > largest.force) largest = pair;
  for (std::size_t i = 0; record.truth && i < saturated.size(); ++i) {
    saturated[i] = saturated[i] || record.truth->saturated[i];
  }
}

std::string Contacts::text() const {
  if (ticks == 0) return "";
  std::string text = fmt::format("contact from {:.3g} s ({}), up to {:.3g} N", first.time_s,
                                 first.geoms, largest.force);
  if (largest.geoms != first.geoms) text += fmt::format(" ({})", largest.geoms);
  const auto numbers = numbers_of(saturated);
  if (numbers.empty()) return text;
  return text + fmt::format(": joint{} {} at {}", numbers.size() == 1 ? "" : "s",
                            fmt::join(numbers, ", "),
                            numbers.size() == 1 ? "its limit" : "their limits");
}

std::string Contacts::heading() const { return ticks == 0 ? "No contact" : "C" + text().substr(1); }

nlohmann::ordered_json to_json(const Contacts& contacts) {
  if (contacts.simulator.empty()) return {};
  return {{"simulator", contacts.simulator},
          {"ticks", contacts.ticks},
          {"first", pair_json(contacts.first)},
          {"largest", pair_json(contacts.largest)},
          {"saturated_joints", numbers_of(contacts.saturated)}};
}

}  // namespace tachless::report
