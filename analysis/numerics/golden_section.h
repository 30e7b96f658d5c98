#pragma once

namespace tachless::numerics {

/// Returns the point between `low` and `high` where f is largest. Searches by golden sections to
/// about a millionth of the interval. f must have a single maximum in the interval.
template <class F>
double largest_between(const F& f, double low, double high) {
  constexpr double golden = 0.6180339887498949;
  constexpr int sections = 30;
  double left = high - golden * (high - low), right = low + golden * (high - low);
  double at_left = f(left), at_right = f(right);
  for (int k = 0; k < sections; ++k) {
    if (at_left < at_right) {
      low = left;
      left = right;
      at_left = at_right;
      at_right = f(right = low + golden * (high - low));
    } else {
      high = right;
      right = left;
      at_right = at_left;
      at_left = f(left = high - golden * (high - low));
    }
  }
  return at_left < at_right ? right : left;
}

}  // namespace tachless::numerics
