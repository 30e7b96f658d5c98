#pragma once

#include <cstddef>
#include <cstring>

#include "base/quantities.h"

namespace tachless {

/// Returns whether two vectors have the same numbers, to the last bit.
inline bool same_bits(const Vector& a, const Vector& b) {
  return a.size() == b.size() &&
         std::memcmp(a.data(), b.data(), sizeof(double) * static_cast<std::size_t>(a.size())) == 0;
}

}  // namespace tachless
