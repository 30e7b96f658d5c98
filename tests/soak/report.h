#pragma once

#include <sys/types.h>

#include <array>
#include <cstdint>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <string>

#include "tests/soak/plan.h"
#include "tests/soak/runner.h"

namespace tachless::soak {

/// Sums over all rounds with one fault.
struct Tally {
  std::int64_t rounds = 0;
  std::int64_t held = 0;
  std::int64_t ticks = 0;
  std::int64_t resends = 0;
  std::int64_t rejected = 0;
  std::int64_t hostile_datagrams = 0;
  std::int64_t missed_deadlines = 0;
  std::int64_t longest_miss = 0;
  double longest_end_s = 0;

  void add(const Outcome& outcome);
};

/// All rounds of a soak, as a table and as JSON. It writes nothing.
class Report {
 public:
  /// @param kept where the round's files are, when it did not hold
  void add(const Round& round, const Outcome& outcome, const std::filesystem::path& kept);

  [[nodiscard]] std::int64_t rounds() const { return std::ssize(entries_); }
  [[nodiscard]] std::int64_t held() const;
  [[nodiscard]] nlohmann::ordered_json json(std::uint64_t first_seed, double elapsed_s) const;
  [[nodiscard]] std::string table(std::uint64_t first_seed, double elapsed_s) const;

 private:
  [[nodiscard]] const Tally& of(Fault fault) const {
    return tallies_[static_cast<std::size_t>(fault)];
  }

  std::array<Tally, num_faults> tallies_;
  std::map<std::string, std::int64_t> peak_kib_, growth_kib_;
  nlohmann::ordered_json entries_ = nlohmann::ordered_json::array();
};

}  // namespace tachless::soak
