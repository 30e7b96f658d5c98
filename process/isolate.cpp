#include "process/isolate.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <net/if.h>
#include <net/route.h>
#include <sched.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <string>
#include <system_error>

#include "process/file_descriptor.h"

namespace tachless::process {
namespace {

[[noreturn]] void fail(const std::string& step, const std::string& remedy) {
  throw std::system_error(errno, std::generic_category(),
                          "private network: cannot " + step + " (" + remedy + ")");
}

void write_file(const char* path, const std::string& text) {
  const FileDescriptor file(::open(path, O_WRONLY | O_CLOEXEC));
  const auto size = static_cast<ssize_t>(text.size());
  if (file.get() < 0 || ::write(file.get(), text.data(), text.size()) != size) {
    fail(std::string("write ") + path, "run as root");
  }
}

void enter_namespaces() {
  if (::unshare(CLONE_NEWNET) == 0) return;
  const std::string uid = std::to_string(::getuid());
  const std::string gid = std::to_string(::getgid());
  if (::unshare(CLONE_NEWUSER | CLONE_NEWNET) != 0) {
    if (errno == EINVAL) fail("leave a process that has threads already", "call it first");
    fail("make a user namespace",
         "run as root, or allow it: `sysctl -w user.max_user_namespaces=1000 "
         "kernel.unprivileged_userns_clone=1`; in Docker: --cap-add SYS_ADMIN");
  }
  write_file("/proc/self/setgroups", "deny");
  write_file("/proc/self/uid_map", "0 " + uid + " 1");
  write_file("/proc/self/gid_map", "0 " + gid + " 1");
}

void raise_loopback(int socket) {
  ifreq request{};
  std::strcpy(request.ifr_name, "lo");
  if (::ioctl(socket, SIOCGIFFLAGS, &request) != 0) fail("look at lo", "run as root");
  request.ifr_flags |= IFF_UP | IFF_MULTICAST;
  if (::ioctl(socket, SIOCSIFFLAGS, &request) != 0) fail("bring lo up", "run as root");
}

sockaddr ipv4(const char* text) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  inet_pton(AF_INET, text, &address.sin_addr);
  sockaddr result{};
  std::memcpy(&result, &address, sizeof result);
  return result;
}

void route_multicast(int socket) {
  std::string device = "lo";
  rtentry route{};
  route.rt_dst = ipv4("224.0.0.0");
  route.rt_genmask = ipv4("240.0.0.0");
  route.rt_flags = RTF_UP;
  route.rt_dev = device.data();
  if (::ioctl(socket, SIOCADDRT, &route) != 0) fail("add the multicast route", "run as root");
}

}  // namespace

void enter_private_network() {
  enter_namespaces();
  const FileDescriptor socket(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  if (socket.get() < 0) fail("open a socket", "the kernel has no IPv4");
  raise_loopback(socket.get());
  route_multicast(socket.get());
}

}  // namespace tachless::process
