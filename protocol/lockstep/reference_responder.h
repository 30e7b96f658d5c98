#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

#include "protocol/lockstep/message_ring.h"
#include "protocol/lockstep/verdict.h"

namespace tachless::protocol::lockstep {

/// The reference's side: TICK(k) requests every reference up to k + 1 that is not yet published, so
/// that nobody waits for the reference, and TICK(k + 1) makes up for a lost TICK(k). The reply to a
/// repeated TICK is the same bytes again.
class ReferenceResponder {
 public:
  /// An empty range has last < first.
  struct Range {
    std::int64_t first = 0;
    std::int64_t last = -1;
  };
  struct Answer {
    Verdict verdict = Verdict::fresh;
    Range compute;  ///< compute these in order, publish each and tell `computed`
    Range repeat;   ///< publish `kept` of these again
  };

  ReferenceResponder(std::int64_t num_ticks, std::size_t longest_tick,
                     std::size_t longest_reference);

  Answer on_tick(std::int64_t tick, std::span<const std::byte> bytes, std::string_view sender);

  /// @throw std::logic_error unless `tick` is the one after the last.
  void computed(std::int64_t tick, std::span<const std::byte> bytes);

  [[nodiscard]] std::span<const std::byte> kept(std::int64_t tick) const;
  /// Who sent the TICK that is kept.
  [[nodiscard]] std::string_view sender_of(std::int64_t tick) const;

  /// Newest tick whose reference is computed; -1 before the first.
  [[nodiscard]] std::int64_t newest() const { return newest_; }

 private:
  std::int64_t num_ticks_;
  std::int64_t newest_ = -1;
  MessageRing ring_;
};

}  // namespace tachless::protocol::lockstep
