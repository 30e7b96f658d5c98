#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

namespace tachless::bus {

/// Of all bytes added so far, in their order (BLAKE2b, 64 bits): nobody finds other bytes that have
/// the same one. Not keyed, proves no origin.
class Digest {
 public:
  Digest();
  void add(std::span<const std::byte> bytes);
  [[nodiscard]] std::int64_t value() const;

 private:
  // libsodium's state, which is nobody else's business.
  alignas(64) std::array<unsigned char, 384> state_;
};

}  // namespace tachless::bus
