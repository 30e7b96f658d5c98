#pragma once

#include <algorithm>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

#include "controller/registry.h"
#include "study/in_process_loop.h"

namespace tachless::study {

/// What stands in for the velocity in a law that does not measure it: the v_hat that it logs, or
/// v_ref + nu of one that filters the error.
class VelocityInUse {
 public:
  explicit VelocityInUse(const std::string& law) {
    const auto signals = controller::law_facts(law).signals;
    const auto named = [&](std::string_view name) {
      return std::ranges::find(signals, name, &loop::Signal::name) - signals.begin();
    };
    const auto all = static_cast<std::ptrdiff_t>(signals.size());
    of_error_ = named("v_hat") == all;
    const std::ptrdiff_t at = of_error_ ? named("nu") : named("v_hat");
    // A motor's is none of the links'.
    if (at < all && controller::law_facts(law).reads_links) at_ = static_cast<std::size_t>(at);
  }

  /// Less the velocity; empty for a law that has none.
  [[nodiscard]] robot::Vector error(const TickRecord& record) const {
    if (!at_) return {};
    const robot::Vector& v_hat = record.controller.value[*at_];
    return (of_error_ ? record.reference.v_ref + v_hat : v_hat) - record.truth.v;
  }

 private:
  std::optional<std::size_t> at_;
  bool of_error_ = false;  ///< of the error: v_ref is missing in it
};

}  // namespace tachless::study
