#include "session/key_check.h"

#include <fmt/core.h>

#include <chrono>
#include <string_view>

#include "base/failure.h"
#include "session/peers.h"

namespace tachless::session {

void KeyCheck::on_foreign(const bus::Stranger& stranger, Time now) {
  if (num_foreign_++ > 0) return;
  since_ = now;
  const std::string_view own = messages::name(own_role_);
  std::string difference = fmt::format("has no key, this {} has one", own);
  if (stranger.tagged) {
    difference = has_key_ ? fmt::format("has another key than this {}", own)
                          : fmt::format("has a key, this {} has none", own);
  }
  first_ = fmt::format("{} {}", describe(stranger.who, stranger.sender), difference);
}

std::string KeyCheck::hint() const { return first_.empty() ? "" : "; " + first_ + " (--key-file)"; }

void KeyCheck::poll(Time now) const {
  // The keys differ: many announcements have come over a long time, and no announcement has
  // verified.
  if (accepted_ || num_foreign_ < 5 || now - since_ < std::chrono::milliseconds(1500)) return;
  throw base::Failure(base::ExitCode::protocol_violated,
                      "{}; give all four programs the same --key-file (or TACHLESS_KEY_FILE)",
                      first_);
}

}  // namespace tachless::session
