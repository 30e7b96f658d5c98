#pragma once

#include <algorithm>
#include <cmath>

namespace tachless::numerics {

/// A point, and the value of a function there.
struct ValueAt {
  double x = 0, value = 0;
};

/// Returns a point where f is negative, within `accuracy` of a point where it is not. Both lie
/// between the two given points. Uses the Illinois method (Dowell and Jarratt, 1971), and halves an
/// interval that three evaluations have not halved. A smooth f needs fewer evaluations than halving
/// alone.
/// @param negative a point where f is negative
/// @param other a point where f is not negative
template <class F>
double last_negative(const F& f, ValueAt negative, ValueAt other, double accuracy) {
  constexpr int most_slow = 3;
  int repeated = 0;  // the sign of the end that moved last; 0: none has
  int slow = 0;      // evaluations since the interval was halved
  double width = std::abs(other.x - negative.x), half = width / 2;
  while (width > accuracy) {
    const auto [low, high] = std::minmax(negative.x, other.x);
    double x =
        (negative.x * other.value - other.x * negative.value) / (other.value - negative.value);
    if (slow == most_slow || !std::isfinite(x)) x = (low + high) / 2;
    // Half the accuracy away from both ends: near a zero, the next value ends the search.
    x = std::clamp(x, low + accuracy / 2, high - accuracy / 2);
    if (!(low < x && x < high)) break;  // neighbouring numbers
    const double value = f(x);
    if (value < 0) {
      negative = {x, value};
      if (repeated < 0) other.value /= 2;
      repeated = -1;
    } else {
      other = {x, value};
      if (repeated > 0) negative.value /= 2;
      repeated = 1;
    }
    width = std::abs(other.x - negative.x);
    slow = width > half ? slow + 1 : 0;
    if (slow == 0) half = width / 2;
    if (slow > most_slow) slow = 0;
  }
  return negative.x;
}

}  // namespace tachless::numerics
