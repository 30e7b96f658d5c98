#pragma once

#include <bitset>
#include <cstddef>
#include <cstdint>

namespace tachless::monitor {

/// Which of consecutive numbers have not been seen, where numbers repeat and come out of order.
/// Memory does not grow.
class SequenceGaps {
 public:
  /// A number may be this much behind the newest; one further behind starts the count over.
  static constexpr std::int64_t window = 1024;

  void see(std::int64_t number);

  /// Forgets the numbers seen and keeps the counts: the next number is a first one.
  void start_over() { any_ = false; }

  /// Numbers between the first and the newest that have not been seen, of all beginnings.
  [[nodiscard]] std::uint64_t missing() const { return missing_; }
  [[nodiscard]] std::uint64_t repeated() const { return repeated_; }
  /// How often the numbers jumped back by more than the window.
  [[nodiscard]] std::uint64_t restarts() const { return restarts_; }
  [[nodiscard]] bool any() const { return any_; }
  /// Precondition: `any`.
  [[nodiscard]] std::int64_t newest() const { return newest_; }

 private:
  static std::size_t place(std::int64_t number) {
    return static_cast<std::size_t>(static_cast<std::uint64_t>(number) % window);
  }
  void begin_at(std::int64_t number);

  std::bitset<window> seen_;  // of the newest `window` numbers
  std::int64_t newest_ = 0;
  bool any_ = false;
  std::uint64_t missing_ = 0;
  std::uint64_t repeated_ = 0;
  std::uint64_t restarts_ = 0;
};

}  // namespace tachless::monitor
