#pragma once

#include <cstddef>
#include <span>

namespace tachless::bus {

/// Before anything of libsodium is used.
/// @throw std::runtime_error if the machine's cryptographic library cannot be used
void require_sodium();

/// What all participants of a bus share and nobody else knows. Kept in memory of its own, which is
/// locked where the system's limit (`ulimit -l`) allows it, is in no core dump, and is wiped when
/// it goes. Not for the hot path: each key takes some pages.
class Key {
 public:
  static constexpr std::size_t size = 32;
  /// Zeros, until they are written over.
  /// @throw std::runtime_error as `require_sodium`
  Key();
  Key(const Key& other);
  Key& operator=(const Key& other);
  ~Key();

  std::span<unsigned char, size> bytes() { return std::span<unsigned char, size>(bytes_, size); }
  [[nodiscard]] std::span<const unsigned char, size> bytes() const {
    return std::span<const unsigned char, size>(bytes_, size);
  }

 private:
  unsigned char* bytes_;
};

}  // namespace tachless::bus
