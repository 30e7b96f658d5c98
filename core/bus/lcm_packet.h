#pragma once

#include <arpa/inet.h>

#include <cstddef>
#include <cstdint>
#include <cstring>

/// LCM's datagrams, numbers in network byte order:
///   short message:  magic, sequence number, channel, NUL, payload
///   fragment:       magic, sequence number, message size, fragment offset (32 bits each),
///                   fragment number, number of fragments (16 bits each);
///                   in fragment 0 then channel, NUL; payload
namespace tachless::bus::lcm_packet {

inline constexpr std::uint32_t short_magic = 0x4c433032;     // "LC02"
inline constexpr std::uint32_t fragment_magic = 0x4c433033;  // "LC03"
inline constexpr std::size_t header_size = 8;
inline constexpr std::size_t fragment_number_offset = 16;
inline constexpr std::size_t fragment_header_size = 20;
inline constexpr std::size_t max_channel_size = 63;    // without the NUL
inline constexpr std::size_t max_short_size = 65'499;  // channel, NUL and payload

/// Returns the 32-bit number at the start of `bytes`.
inline std::uint32_t word_at(const std::byte* bytes) {
  std::uint32_t word = 0;
  std::memcpy(&word, bytes, sizeof word);
  return ntohl(word);
}

}  // namespace tachless::bus::lcm_packet
