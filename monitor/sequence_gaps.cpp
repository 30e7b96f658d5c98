#include "monitor/sequence_gaps.h"

#include <algorithm>

namespace tachless::monitor {

void SequenceGaps::begin_at(std::int64_t number) {
  any_ = true;
  newest_ = number;
  seen_.set();  // what came before the first is not missed
}

void SequenceGaps::see(std::int64_t number) {
  if (!any_) {
    begin_at(number);
  } else if (number > newest_) {
    // Unsigned: the numbers may be anything, their distance always fits.
    const std::uint64_t skipped =
        static_cast<std::uint64_t>(number) - static_cast<std::uint64_t>(newest_) - 1;
    missing_ += skipped;
    const auto places = std::min<std::uint64_t>(skipped, window - 1);
    for (std::uint64_t i = 1; i <= places; ++i) {
      seen_.reset(place(number - static_cast<std::int64_t>(i)));
    }
    seen_.set(place(number));
    newest_ = number;
  } else if (static_cast<std::uint64_t>(newest_) - static_cast<std::uint64_t>(number) >= window) {
    ++restarts_;
    begin_at(number);
  } else if (seen_.test(place(number))) {
    ++repeated_;
  } else {
    seen_.set(place(number));
    --missing_;
  }
}

}  // namespace tachless::monitor
