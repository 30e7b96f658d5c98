#include "bus/isolate.h"

#include <gtest/gtest.h>
#include <sys/prctl.h>
#include <sys/types.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <string>

#include "bus/network_check.h"
#include "bus/udp_transport.h"

namespace bus {
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
  const auto route = multicast_route({});
  if (!route || route->interface != "lo" || !route->up || !route->multicast) return 2;
  return check_network({}) ? 3 : 0;
}

TEST(PrivateNetwork, HasALoopbackWithWorkingMulticast) {
  EXPECT_EQ(in_child(leaves_with_working_multicast), 0);
}
TEST(PrivateNetwork, LeavesTheOuterProcessWhereItWas) {
  const std::string before = network();
  EXPECT_EQ(in_child(leaves_with_working_multicast), 0);
  EXPECT_EQ(network(), before);
}
TEST(PrivateNetwork, NeedsNoRoot) {
  EXPECT_EQ(in_child([] {
              // As a plain user: a user namespace comes along, in which we are root.
              if (::getuid() == 0 && (::setgid(65534) != 0 || ::setuid(65534) != 0)) return 10;
              ::prctl(PR_SET_DUMPABLE, 1);  // which a change of user takes away, and /proc with it
              const int result = leaves_with_working_multicast();
              return result != 0 ? result : ::getuid() == 0 ? 0 : 11;
            }),
            0);
}
TEST(PrivateNetwork, MayBeEnteredTwice) {
  EXPECT_EQ(in_child([] {
              enter_private_network();
              return leaves_with_working_multicast();
            }),
            0);
}
TEST(PrivateNetwork, DoesNotHearAnother) {
  EXPECT_EQ(in_child([] {
              enter_private_network();
              UdpTransport outside;
              enter_private_network();  // sockets stay where they were opened
              UdpTransport inside;
              inside.subscribe("CHANNEL");
              outside.publish("CHANNEL", {});
              return inside.receive(Clock::now() + std::chrono::milliseconds(100)) ? 1 : 0;
            }),
            0);
}

}  // namespace
}  // namespace bus
