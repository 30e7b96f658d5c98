#pragma once

#include <array>
#include <cstddef>

namespace tachless::bus {

/// What all participants of a bus share and nobody else knows. Wiped when it goes.
struct Key {
  static constexpr std::size_t size = 32;
  Key() = default;
  Key(const Key&) = default;
  Key& operator=(const Key&) = default;
  ~Key();
  std::array<unsigned char, size> bytes{};
};

}  // namespace tachless::bus
