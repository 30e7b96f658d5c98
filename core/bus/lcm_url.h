#pragma once

#include <cstdint>
#include <string>

namespace tachless::bus {

/// Address of a bus, as in an LCM URL of the provider udpm.
struct LcmUrl {
  std::string group = "239.255.76.67";  ///< IPv4 multicast address
  std::uint16_t port = 7667;
  int ttl = 0;                   ///< hops: 0 stays on this host, 1 on the local network
  int receive_buffer_bytes = 0;  ///< `recv_buf_size`; 0: 4 MiB

  [[nodiscard]] std::string text() const;  ///< "udpm://239.255.76.67:7667?ttl=0"
};

/// Reads `udpm://[GROUP][:PORT][?ttl=N&recv_buf_size=N]`; omitted parts have LCM's defaults. An
/// empty text means $LCM_DEFAULT_URL, or LCM's default if that variable is not set.
/// @throw std::invalid_argument naming the URL, the wrong part and the allowed values
LcmUrl parse_lcm_url(const std::string& text);

}  // namespace tachless::bus
