#include "bus/key.h"

#include <sodium.h>

#include <algorithm>
#include <new>
#include <stdexcept>

namespace tachless::bus {

void require_sodium() {
  if (sodium_init() < 0) throw std::runtime_error("libsodium cannot be used on this machine");
}

namespace {

unsigned char* protected_bytes() {
  require_sodium();
  auto* bytes = static_cast<unsigned char*>(sodium_malloc(Key::size));
  if (bytes == nullptr) throw std::bad_alloc();
  sodium_memzero(bytes, Key::size);
  return bytes;
}

}  // namespace

Key::Key() : bytes_(protected_bytes()) {}

Key::Key(const Key& other) : Key() { *this = other; }

Key& Key::operator=(const Key& other) {
  if (this != &other) std::ranges::copy(other.bytes(), bytes_);
  return *this;
}

Key::~Key() { sodium_free(bytes_); }

}  // namespace tachless::bus
