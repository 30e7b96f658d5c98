#include "bus/channel_filter.h"

#include <algorithm>
#include <cstdint>
#include <stdexcept>

#include "bus/lcm_packet.h"

namespace tachless::bus {
namespace {

// What a filter of a UDP socket sees begins with the UDP header.
constexpr std::uint32_t udp_header = 8;
constexpr std::uint32_t accept = 0xffffffff;
constexpr std::uint32_t reject = 0;

constexpr std::uint16_t load_word = BPF_LD | BPF_W | BPF_ABS;
constexpr std::uint16_t load_half = BPF_LD | BPF_H | BPF_ABS;
constexpr std::uint16_t load_index = BPF_LDX | BPF_IMM;
constexpr std::uint16_t jump = BPF_JMP | BPF_JA;
constexpr std::uint16_t jump_equal = BPF_JMP | BPF_JEQ | BPF_K;
constexpr std::uint16_t give_back = BPF_RET | BPF_K;

struct Piece {
  std::uint16_t load;  // relative to the index register, which holds the channel's offset
  std::uint32_t offset;
  std::uint32_t value;
};

std::vector<Piece> pieces(const std::string& channel) {
  const std::size_t size = channel.size() + 1;  // the NUL belongs to the name
  const auto value = [&](std::size_t offset, std::size_t width) {
    std::uint32_t result = 0;
    for (std::size_t i = 0; i < width; ++i) {
      result = result << 8 | static_cast<unsigned char>(channel.c_str()[offset + i]);
    }
    return result;
  };
  std::vector<Piece> result;
  std::size_t at = 0;
  const auto add = [&](std::uint16_t width_code, std::size_t width) {
    result.push_back({static_cast<std::uint16_t>(BPF_LD | width_code | BPF_IND),
                      static_cast<std::uint32_t>(at), value(at, width)});
    at += width;
  };
  while (at + 4 <= size) add(BPF_W, 4);
  if (at + 2 <= size) add(BPF_H, 2);
  if (at < size) add(BPF_B, 1);
  return result;
}

}  // namespace

std::vector<sock_filter> channel_filter(std::vector<std::string> channels) {
  // A load beyond the datagram's end rejects at once. Shortest name first: what is too short to
  // be compared with one name is too short for all that follow.
  std::sort(channels.begin(), channels.end(),
            [](const auto& a, const auto& b) { return a.size() < b.size(); });

  constexpr std::uint32_t short_channel = udp_header + lcm_packet::header_size;
  constexpr std::uint32_t fragment_channel = udp_header + lcm_packet::fragment_header_size;
  std::vector<sock_filter> program = {
      {load_word, 0, 0, udp_header},
      {jump_equal, 0, 2, lcm_packet::short_magic},
      {load_index, 0, 0, short_channel},
      {jump, 0, 0, 6},  // to the names
      {jump_equal, 1, 0, lcm_packet::fragment_magic},
      {give_back, 0, 0, reject},
      {load_half, 0, 0, udp_header + lcm_packet::fragment_number_offset},
      {jump_equal, 1, 0, 0},
      {give_back, 0, 0, reject},
      {load_index, 0, 0, fragment_channel},
  };
  for (const std::string& channel : channels) {
    const std::vector<Piece> name = pieces(channel);
    const std::size_t end = 2 * name.size() + 1;
    for (std::size_t i = 0; i < name.size(); ++i) {
      program.push_back({name[i].load, 0, 0, name[i].offset});
      const auto to_next_name = static_cast<std::uint8_t>(end - (2 * i + 2));
      program.push_back({jump_equal, 0, to_next_name, name[i].value});
    }
    program.push_back({give_back, 0, 0, accept});
  }
  program.push_back({give_back, 0, 0, reject});
  if (program.size() > BPF_MAXINSNS) {
    throw std::invalid_argument("too many channels for one socket filter: " +
                                std::to_string(channels.size()) + "; use subscribe_all");
  }
  return program;
}

}  // namespace tachless::bus
