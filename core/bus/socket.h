#pragma once

#include <linux/filter.h>
#include <poll.h>
#include <sys/socket.h>

#include <span>
#include <string>
#include <vector>

#include "base/clock.h"
#include "base/file_descriptor.h"
#include "bus/lcm_url.h"

/// The sockets of a bus: opening, setting and waiting. The functions for a bus over UDP multicast
/// throw std::system_error naming the bus, the failed operation and the remedy. This header neither
/// sends nor receives.
namespace tachless::bus {

/// Waits until one of the descriptors is ready, `deadline` has come, or a signal has been handled.
/// @return the result of ppoll: the number of ready descriptors; 0 at the deadline; -1 with errno,
/// EINTR for a signal
int poll_until(std::span<pollfd> descriptors, base::Clock::time_point deadline);

[[noreturn]] void fail_with_errno(const LcmUrl& url, const std::string& what);

template <class Value>
void set(const LcmUrl& url, int fd, int level, int option, const Value& value, const char* what) {
  if (::setsockopt(fd, level, option, &value, sizeof value) != 0) fail_with_errno(url, what);
}
template <class Value>
Value get(const LcmUrl& url, int fd, int option, const char* what) {
  Value value{};
  socklen_t size = sizeof value;
  if (::getsockopt(fd, SOL_SOCKET, option, &value, &size) != 0) fail_with_errno(url, what);
  return value;
}

/// Returns a socket bound to the group, with a large buffer and a filter that rejects everything.
base::FileDescriptor open_receiver(const LcmUrl& url);

/// Returns a socket connected to the group.
base::FileDescriptor open_sender(const LcmUrl& url);

/// Makes the kernel pass only datagrams of these channels from now on.
void install_filter(const LcmUrl& url, int fd, const std::vector<std::string>& channels);

/// Returns a classic BPF program for a UDP socket that passes exactly the LCM messages of the given
/// channels. The kernel then drops all other datagrams before it wakes the process. The program
/// passes the first fragment of any fragmented message on these channels. Without a channel it
/// passes nothing.
/// @throw std::invalid_argument if the channels are too many for one program
std::vector<sock_filter> channel_filter(std::vector<std::string> channels);

}  // namespace tachless::bus
