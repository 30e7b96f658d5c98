#pragma once

#include <algorithm>
#include <bitset>
#include <cstddef>
#include <cstdint>

namespace tachless::live {

/// Count of missing sequence numbers. Numbers may repeat and arrive out of order. Memory does not
/// grow.
class SequenceGaps {
 public:
  /// Largest distance of a number behind the newest one. A number further behind starts the count
  /// again.
  static constexpr std::int64_t window = 1024;

  void see(std::int64_t number) {
    // Unsigned: the numbers may be anything, their distance always fits.
    const auto ahead = static_cast<std::uint64_t>(number) - static_cast<std::uint64_t>(newest_);
    if (!any_) {
      begin_at(number);
    } else if (number > newest_) {
      missing_ += ahead - 1;
      const auto places = std::min<std::uint64_t>(ahead - 1, window - 1);
      for (std::uint64_t i = 1; i <= places; ++i) {
        seen_.reset(place(number - static_cast<std::int64_t>(i)));
      }
      seen_.set(place(number));
      newest_ = number;
    } else if (-ahead >= window) {
      ++restarts_;
      begin_at(number);
    } else if (seen_.test(place(number))) {
      ++repeated_;
    } else {
      seen_.set(place(number));
      --missing_;
    }
  }

  /// Forgets the numbers seen and keeps the counts: the next number is a first one.
  void start_over() { any_ = false; }

  /// Returns the count of numbers between the first and the newest that have not been seen, summed
  /// over all starts of the count.
  [[nodiscard]] std::uint64_t missing() const { return missing_; }
  [[nodiscard]] std::uint64_t repeated() const { return repeated_; }
  /// Returns how often the numbers jumped back by more than the window.
  [[nodiscard]] std::uint64_t restarts() const { return restarts_; }
  [[nodiscard]] bool any() const { return any_; }
  /// Returns the newest number. Precondition: `any`.
  [[nodiscard]] std::int64_t newest() const { return newest_; }

 private:
  static std::size_t place(std::int64_t number) {
    return static_cast<std::size_t>(static_cast<std::uint64_t>(number) % window);
  }
  void begin_at(std::int64_t number) {
    any_ = true;
    newest_ = number;
    seen_.set();  // numbers before the first are not missing
  }

  std::bitset<window> seen_;  // of the newest `window` numbers
  std::int64_t newest_ = 0;
  bool any_ = false;
  std::uint64_t missing_ = 0;
  std::uint64_t repeated_ = 0;
  std::uint64_t restarts_ = 0;
};

}  // namespace tachless::live
