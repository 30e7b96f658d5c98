#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace tachless::base {

/// Values of the last `size` ticks. A tick takes the place of the tick `size` before it. Nothing is
/// allocated after the constructor.
template <class T>
class TickRing {
 public:
  /// @param size number of ticks, above 0
  /// @param initial value of each place
  explicit TickRing(std::int64_t size, const T& initial = T())
      : places_(static_cast<std::size_t>(size), initial) {}

  /// Returns the place of `tick`, which must not be negative. The caller knows which tick wrote it.
  [[nodiscard]] T& operator[](std::int64_t tick) { return places_[index(tick)]; }
  [[nodiscard]] const T& operator[](std::int64_t tick) const { return places_[index(tick)]; }

  [[nodiscard]] std::int64_t size() const { return static_cast<std::int64_t>(places_.size()); }
  /// Sets each place.
  void fill(const T& value) { places_.assign(places_.size(), value); }

 private:
  [[nodiscard]] std::size_t index(std::int64_t tick) const {
    return static_cast<std::size_t>(tick) % places_.size();
  }

  std::vector<T> places_;
};

}  // namespace tachless::base
