#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

#include "protocol/lockstep/message_ring.h"
#include "protocol/lockstep/verdict.h"

namespace tachless::protocol::realtime {

/// The reference's side: TICK(k) requests the references of k and k + 1 that are not yet published.
/// Those of ticks whose TICK was lost are not published later.
class ReferenceResponder {
 public:
  struct Answer {
    lockstep::Verdict verdict = lockstep::Verdict::fresh;
    /// Publish these in order; none when last < first.
    std::int64_t first = 0;
    std::int64_t last = -1;
  };

  ReferenceResponder(std::int64_t num_ticks, std::size_t longest_tick);

  Answer on_tick(std::int64_t tick, std::span<const std::byte> bytes, std::string_view sender);

  /// Who sent the TICK that is kept.
  [[nodiscard]] std::string_view sender_of(std::int64_t tick) const;
  /// Newest tick whose reference was requested; -1 before the first.
  [[nodiscard]] std::int64_t newest() const { return newest_; }

 private:
  std::int64_t num_ticks_;
  std::int64_t newest_ = -1;
  lockstep::MessageRing ticks_;
};

}  // namespace tachless::protocol::realtime
