#pragma once

#include <netinet/in.h>
#include <sys/socket.h>

#include <cstdint>

/// Addresses of the emulated controllers, which serve this machine alone.
namespace tachless::plant {

/// Returns the address 127.0.0.1 with a port; port 0: any.
inline sockaddr_in loopback(std::uint16_t port) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(port);
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  return address;
}

/// Returns an address in the form that the calls of sockets take.
inline const sockaddr* generic(const sockaddr_in& address) {
  return reinterpret_cast<const sockaddr*>(&address);
}

}  // namespace tachless::plant
