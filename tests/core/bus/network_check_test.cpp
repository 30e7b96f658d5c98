#include "bus/network_check.h"

#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <sched.h>
#include <sys/socket.h>

#include <chrono>
#include <cstdlib>

#include "base/file_descriptor.h"
#include "bus/transport.h"
#include "tests/support/private_network.h"

namespace tachless::bus {
namespace {

using testing::HasSubstr;

/// Fixture of tests that each start in a working network of their own and break it.
class NetworkCheck : public testing::Test {
 protected:
  void SetUp() override { base::enter_private_network(); }

  static void shell(const std::string& command) {
    ASSERT_EQ(std::system(command.c_str()), 0) << command;
  }

  /// Runs the check and bounds its time. It takes less than a second on an idle machine; a check
  /// that hangs takes 10 s.
  static std::optional<NetworkProblem> check() {
    const auto start = base::Clock::now();
    const auto problem = check_network(url);
    EXPECT_LT(base::Clock::now() - start, std::chrono::seconds(9));
    return problem;
  }

  static void expect_mended_by_remedy() {
    const auto problem = check();
    ASSERT_TRUE(problem);
    shell(problem->remedy);
    const auto after = check();
    EXPECT_FALSE(after) << after->what;
  }

  inline static const LcmUrl url;
};

TEST_F(NetworkCheck, IsContentWhereMulticastWorks) {
  const auto problem = check();
  EXPECT_FALSE(problem) << problem->what;
}
TEST_F(NetworkCheck, NamesAMissingRoute) {
  shell("ip route del 224.0.0.0/4 dev lo");
  EXPECT_FALSE(multicast_route(url));
  EXPECT_EQ(check()->what, "there is no route to the multicast group 239.255.76.67");
  expect_mended_by_remedy();
}
TEST_F(NetworkCheck, NamesAnInterfaceThatIsDown) {
  shell("ip link set lo down");
  EXPECT_THAT(check()->what, HasSubstr("lo is down"));
  expect_mended_by_remedy();
}
TEST_F(NetworkCheck, NamesAFreshNamespaceAsAnInterfaceThatIsDown) {
  ASSERT_EQ(::unshare(CLONE_NEWNET), 0);
  EXPECT_THAT(check()->what, HasSubstr("lo is down"));
  expect_mended_by_remedy();
}
TEST_F(NetworkCheck, NamesAnInterfaceWithoutMulticast) {
  shell("ip link set lo multicast off");
  EXPECT_FALSE(multicast_route(url)->multicast);
  EXPECT_THAT(check()->what, HasSubstr("lo, to which the route"));
  expect_mended_by_remedy();
}
TEST_F(NetworkCheck, NamesAFirewallThatDropsOnTheWayIn) {
  shell(
      "nft 'add table ip t; add chain ip t in {type filter hook input priority 0;}; "
      "add rule ip t in udp dport 7667 drop'");
  const auto problem = check();
  ASSERT_TRUE(problem);
  EXPECT_THAT(problem->what, AllOf(HasSubstr("do not arrive"), HasSubstr("firewall")));
  EXPECT_THAT(problem->remedy, HasSubstr("INPUT"));
}
TEST_F(NetworkCheck, NamesAFirewallThatDropsOnTheWayOut) {
  shell(
      "nft 'add table ip t; add chain ip t out {type filter hook output priority 0;}; "
      "add rule ip t out udp dport 7667 drop'");
  const auto problem = check();
  ASSERT_TRUE(problem);
  EXPECT_THAT(problem->what, AllOf(HasSubstr("not let out"), HasSubstr("firewall")));
  EXPECT_THAT(problem->remedy, HasSubstr("OUTPUT"));
}
TEST_F(NetworkCheck, NamesAPortThatIsTaken) {
  const base::FileDescriptor selfish(::socket(AF_INET, SOCK_DGRAM, 0));
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(url.port);
  ASSERT_EQ(::bind(selfish.get(), reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
  const auto problem = check();
  ASSERT_TRUE(problem);
  EXPECT_THAT(problem->what, HasSubstr("7667"));
  EXPECT_THAT(problem->remedy, HasSubstr("ss -ulpn"));
}
TEST_F(NetworkCheck, KnowsTheWayOut) {
  const auto route = multicast_route(url);
  ASSERT_TRUE(route);
  EXPECT_EQ(route->interface, "lo");
  EXPECT_TRUE(route->multicast);
  shell(
      "ip link add side type veth peer name other && ip addr add 10.9.9.9/24 dev side && ip link "
      "set side up && "
      "ip route add 239.0.0.0/8 dev side");
  EXPECT_EQ(multicast_route(url)->interface, "side");
}

}  // namespace
}  // namespace tachless::bus
