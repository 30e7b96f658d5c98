#include "cli/doctor.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <string>
#include <thread>
#include <vector>

#include "base/this_process.h"
#include "bus/udp_transport.h"

namespace tachless::cli::doctor_test {
namespace {

using ::testing::HasSubstr;

TEST(CheckUp, WantsRoomForABurst) {
  const Finding small = judge_receive_buffer(212'992);
  EXPECT_FALSE(small.ok());
  EXPECT_THAT(small.what, HasSubstr("208 KiB"));
  EXPECT_EQ(small.remedy, "sudo sysctl -w net.core.rmem_max=2097152");
  EXPECT_TRUE(judge_receive_buffer(2'097'152).ok());
  EXPECT_FALSE(judge_receive_buffer(2'097'152).remedy.has_value());
}

TEST(CheckUp, WarnsOfMessagesThatStayOnThisHostAndOfSuchThatGoTooFar) {
  const auto url = [](const std::string& ttl) {
    return bus::parse_lcm_url("udpm://239.255.76.67:7667?ttl=" + ttl);
  };
  EXPECT_TRUE(judge_ttl(url("0"), "lo").ok());
  EXPECT_TRUE(judge_ttl(url("1"), "eth0").ok());
  const Finding stuck = judge_ttl(url("1"), "lo");
  EXPECT_FALSE(stuck.ok());
  EXPECT_THAT(stuck.what, HasSubstr("nothing leaves this host"));
  EXPECT_THAT(*stuck.remedy, HasSubstr("ip route replace 224.0.0.0/4"));
  EXPECT_THAT(*judge_ttl(url("3"), "eth0").remedy, HasSubstr("ttl=1"));
}

TEST(CheckUp, CountsDurationsInBins) {
  const std::vector<Bin> bins = bins_of({{81.92, 7}, {98.3, 2}, {110.0, 40}, {614.4, 1}});
  ASSERT_EQ(bins.size(), 4U);
  const std::vector<double> edges = {50, 100, 200, 500, 1000};
  const std::vector<std::int64_t> counts = {9, 40, 0, 1};
  for (std::size_t i = 0; i < bins.size(); ++i) {
    EXPECT_EQ(bins[i].from_us, edges[i]);
    EXPECT_EQ(bins[i].to_us, edges[i + 1]);
    EXPECT_EQ(bins[i].count, counts[i]);
  }
  EXPECT_THAT(text(bins), HasSubstr("50 to    100 us         9  #########\n"));
  EXPECT_THAT(text(bins), HasSubstr("200 to    500 us         0\n"));
  EXPECT_EQ(bins_of({{0.5, 3}}).front().from_us, 0);
  EXPECT_TRUE(bins_of({}).empty());
}

TEST(CheckUp, WarnsOfSlowClocks) {
  EXPECT_FALSE(judge_clock_source("acpi_pm").ok());
  EXPECT_THAT(*judge_clock_source("hpet").remedy, HasSubstr("echo tsc"));
  EXPECT_TRUE(judge_clock_source("tsc").ok());
  EXPECT_TRUE(judge_clock_source("kvm-clock").ok());
}

TEST(CheckUp, WarnsOfAHostThatTakesTimeAway) {
  // user nice system idle iowait irq softirq steal guest guest_nice
  const Finding shared = judge_stolen_time("cpu  500 100 100 260 0 0 30 10 70 7\ncpu0 1 2 3\n");
  EXPECT_TRUE(shared.ok()) << "nothing that can be typed here mends it";
  EXPECT_TRUE(shared.warns);
  EXPECT_THAT(shared.what, AllOf(HasSubstr("took 1.00 %"), HasSubstr("loop.max_missed=100")));
  EXPECT_TRUE(judge_stolen_time("cpu  500 100 100 2600 0 0 30 0 0 0\n").ok());
  EXPECT_TRUE(judge_stolen_time("").ok());
  EXPECT_TRUE(judge_stolen_time("cpu  0 0 0 0 0 0 0 0\n").ok()) << "a kernel that does not count";
}

TEST(CheckUp, WantsAGibibyteOfDisk) {
  EXPECT_FALSE(judge_disk(1'000'000'000, ".").ok());
  EXPECT_TRUE(judge_disk(1'100'000'000, ".").ok());
}

TEST(CheckUp, NamesAUrlThatCannotBeUsed) {
  const std::vector<Finding> findings = examine("tcp://somewhere", ".");
  EXPECT_EQ(findings.front().subject, "multicast");
  EXPECT_FALSE(findings.front().ok());
  EXPECT_THAT(*findings.front().remedy, HasSubstr("export LCM_DEFAULT_URL="));
}

TEST(CheckUp, FindsAPrivateNetworkFitAndEmpty) {
  const pid_t child = fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    base::enter_private_network();
    const std::vector<Finding> findings = examine("udpm://239.255.76.67:7667?ttl=0", ".");
    const auto ok = [&](const char* subject) {
      return std::any_of(findings.begin(), findings.end(), [&](const Finding& finding) {
        return finding.subject == subject && finding.ok();
      });
    };
    _exit(ok("multicast") && ok("other publishers") && ok("ttl") ? 0 : 1);
  }
  int status = 1;
  waitpid(child, &status, 0);
  EXPECT_EQ(status, 0);
}

TEST(CheckUp, PrintsNoControlCharacterOfAChannelsName) {
  const pid_t child = fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    base::enter_private_network();
    const std::jthread other([](const std::stop_token& over) {
      bus::UdpTransport bus;
      for (; !over.stop_requested(); std::this_thread::sleep_for(std::chrono::milliseconds(5))) {
        bus.publish("HOSTILE\x1b[2J\n", {});
      }
    });
    bool named = false, clean = true;
    for (const Finding& finding : examine("udpm://239.255.76.67:7667?ttl=0", ".")) {
      named = named || finding.what.find("HOSTILE") != std::string::npos;
      clean = clean && finding.what.find_first_of("\x1b\n") == std::string::npos;
    }
    _exit(named && clean ? 0 : 1);
  }
  int status = 1;
  waitpid(child, &status, 0);
  EXPECT_EQ(status, 0);
}

TEST(CheckUp, NamesACommandExactlyWhereSomethingIsWrong) {
  for (const Finding& finding : examine("udpm://239.255.76.67:7667?ttl=3", ".")) {
    EXPECT_NE(finding.remedy, "") << finding.subject;
    EXPECT_FALSE(finding.what.empty()) << finding.subject;
  }
}

}  // namespace
}  // namespace tachless::cli::doctor_test
