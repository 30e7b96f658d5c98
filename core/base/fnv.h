#pragma once

#include <cstdint>
#include <string_view>

namespace tachless::base {

inline constexpr std::uint64_t fnv_of_nothing = 0xcbf29ce484222325;

/// Returns the 64-bit FNV-1a hash, which distinguishes texts and is not secure.
/// @param hash the hash of the text before `text`
constexpr std::uint64_t fnv(std::string_view text, std::uint64_t hash = fnv_of_nothing) {
  for (const char c : text) hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001b3;
  return hash;
}

}  // namespace tachless::base
