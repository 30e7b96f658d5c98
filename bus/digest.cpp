#include "bus/digest.h"

#include <sodium.h>

#include <cstring>

#include "bus/key.h"

namespace tachless::bus {
namespace {

// libsodium promises at least 16 bytes; of so many 8 are used.
constexpr std::size_t size = crypto_generichash_BYTES_MIN;

crypto_generichash_state* in(unsigned char* bytes) {
  return reinterpret_cast<crypto_generichash_state*>(bytes);
}

}  // namespace

Digest::Digest() : state_{} {
  static_assert(sizeof(state_) == sizeof(crypto_generichash_state));
  require_sodium();
  crypto_generichash_init(in(state_.data()), nullptr, 0, size);
}

void Digest::add(std::span<const std::byte> bytes) {
  crypto_generichash_update(in(state_.data()), reinterpret_cast<const unsigned char*>(bytes.data()),
                            bytes.size());
}

std::int64_t Digest::value() const {
  Digest copy = *this;
  std::array<unsigned char, size> whole{};
  crypto_generichash_final(in(copy.state_.data()), whole.data(), whole.size());
  std::int64_t result = 0;
  std::memcpy(&result, whole.data(), sizeof result);
  return result;
}

}  // namespace tachless::bus
