#include "node/key_check.h"

#include <fmt/core.h>

#include <chrono>

#include "diagnostics/failure.h"

namespace tachless::node {
namespace {

using namespace std::chrono_literals;

// No announcement that verifies among so many for so long: the keys differ.
constexpr int fewest = 5;
constexpr auto shortest = 1500ms;

}  // namespace

void KeyCheck::foreign(bus::Foreign kind, const loop::Participant& who, std::string_view sender,
                       loop::Clock::time_point now) {
  if (num_foreign_++ > 0) return;
  since_ = now;
  const std::string_view own = loop::name(own_role_);
  std::string difference = fmt::format("has no key, this {}", own);
  if (kind == bus::Foreign::other_key) {
    difference = fmt::format("has {} key{} this {}", has_key_ ? "another" : "a",
                             has_key_ ? " than" : ",", own);
  }
  first_ = fmt::format("the {} (process {}{}{}, {}) {}{}", loop::name(who.role), who.pid,
                       who.host.empty() ? "" : " on ", who.host, sender, difference,
                       has_key_ ? "" : " has none");
}

void KeyCheck::poll(loop::Clock::time_point now) const {
  if (accepted_ || num_foreign_ < fewest || now - since_ < shortest) return;
  throw diagnostics::Failure(
      diagnostics::ExitCode::protocol_violated,
      "{}; give all four programs the same --key-file (or TACHLESS_KEY_FILE)", first_);
}

}  // namespace tachless::node
