#pragma once

#include <cstdint>
#include <map>
#include <string>

#include "tests/campaign/round.h"

namespace tachless::campaign {

/// Counts rounds and their outcome by kind, for a table. Judges nothing.
class Tally {
 public:
  void add(const Evidence& evidence, bool broken);

  [[nodiscard]] std::int64_t rounds() const;
  [[nodiscard]] std::int64_t broken() const;
  /// A line for each kind.
  [[nodiscard]] std::string text() const;

 private:
  struct OfKind {
    std::int64_t rounds = 0, ended_well = 0, broken = 0, hostile = 0;
    double longest_s = 0;
  };
  std::map<std::string, OfKind> kinds_;
};

}  // namespace tachless::campaign
