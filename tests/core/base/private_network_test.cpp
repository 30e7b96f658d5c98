#include "base/this_process.h"

#include <gtest/gtest.h>
#include <linux/capability.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <sys/types.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <stdexcept>
#include <string>

#include "bus/network_check.h"
#include "bus/udp_transport.h"
#include "tests/support/sanitizer.h"

namespace tachless::base {
namespace {

/// Runs `body` in a child, which leaves this process' own network alone; its exit code.
template <class Body>
int in_child(Body body) {
  const pid_t child = ::fork();
  if (child == 0) {
    int code = 99;
    try {
      code = body();
    } catch (const std::exception& error) {
      std::fprintf(stderr, "%s\n", error.what());
    }
    ::_exit(code);
  }
  int status = 0;
  EXPECT_EQ(::waitpid(child, &status, 0), child);
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

std::string network() { return std::filesystem::read_symlink("/proc/self/ns/net").string(); }

int leaves_with_working_multicast() {
  const std::string before = network();
  enter_private_network();
  if (network() == before) return 1;
  const auto route = bus::multicast_route({});
  if (!route || route->interface != "lo" || !route->multicast) return 2;
  return bus::check_network({}) ? 3 : 0;
}

TEST(PrivateNetwork, HasALoopbackWithWorkingMulticast) {
  EXPECT_EQ(in_child(leaves_with_working_multicast), 0);
}
TEST(PrivateNetwork, LeavesTheOuterProcessWhereItWas) {
  const std::string before = network();
  EXPECT_EQ(in_child(leaves_with_working_multicast), 0);
  EXPECT_EQ(network(), before);
}
// ThreadSanitizer keeps a thread of its own, and a process with threads may not enter a user
// namespace.
#ifndef __SANITIZE_THREAD__
/// Becomes a plain user; where root is only a name in a user namespace, loses its rights instead.
void give_up_privileges() {
  if (::getuid() != 0) return;
  if (::setgid(65534) == 0 && ::setuid(65534) == 0) {
    ::prctl(PR_SET_DUMPABLE, 1);  // which a change of user takes away, and /proc with it
    return;
  }
  __user_cap_header_struct header{_LINUX_CAPABILITY_VERSION_3, 0};
  std::array<__user_cap_data_struct, _LINUX_CAPABILITY_U32S_3> data{};
  if (::syscall(SYS_capget, &header, data.data()) != 0) throw std::runtime_error("capget");
  data[0].effective &= ~(1U << CAP_SYS_ADMIN);
  data[0].permitted &= ~(1U << CAP_SYS_ADMIN);
  if (::syscall(SYS_capset, &header, data.data()) != 0) throw std::runtime_error("capset");
}

TEST(PrivateNetwork, NeedsNoRoot) {
  EXPECT_EQ(in_child([] {
              give_up_privileges();
              const int result = leaves_with_working_multicast();
              return result != 0 ? result : ::getuid() == 0 ? 0 : 11;
            }),
            0);
}
#endif
TEST(PrivateNetwork, MayBeEnteredTwice) {
  EXPECT_EQ(in_child([] {
              enter_private_network();
              return leaves_with_working_multicast();
            }),
            0);
}
TEST(PrivateNetwork, DoesNotHearAnother) {
  EXPECT_EQ(
      in_child([] {
        enter_private_network();
        bus::UdpTransport outside;
        enter_private_network();  // sockets stay where they were opened
        bus::UdpTransport inside;
        inside.subscribe("CHANNEL");
        outside.publish("CHANNEL", {});
        return inside.receive(std::chrono::steady_clock::now() + std::chrono::milliseconds(100))
                   ? 1
                   : 0;
      }),
      0);
}

}  // namespace
}  // namespace tachless::base
