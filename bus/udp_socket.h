#pragma once

#include <sys/socket.h>

#include <string>
#include <vector>

#include "bus/lcm_url.h"
#include "process/file_descriptor.h"

/// The two sockets of a bus over UDP multicast. All throw std::system_error naming the bus, what
/// failed and the remedy.
namespace tachless::bus {

[[noreturn]] void fail_with_errno(const LcmUrl& url, const std::string& what);

template <class Value>
void set(const LcmUrl& url, int fd, int level, int option, const Value& value, const char* what) {
  if (::setsockopt(fd, level, option, &value, sizeof value) != 0) fail_with_errno(url, what);
}

/// Bound to the group, with a large buffer and a filter that lets nothing through.
process::FileDescriptor open_receiver(const LcmUrl& url);

/// Connected to the group.
process::FileDescriptor open_sender(const LcmUrl& url);

/// From now on the kernel passes on datagrams of these channels alone.
void install_filter(const LcmUrl& url, int fd, const std::vector<std::string>& channels);

}  // namespace tachless::bus
