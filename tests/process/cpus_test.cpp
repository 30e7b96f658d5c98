#include "process/cpus.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <algorithm>
#include <filesystem>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "process/child.h"
#include "tests/support/temporary_directory.h"

namespace tachless::process {
namespace {

using ::testing::ElementsAre;
using ::testing::EndsWith;

TEST(Cpus, AreTheOnesThatTheKernelAllows) {
  const std::vector<int> cpus = allowed_cpus();
  ASSERT_FALSE(cpus.empty());
  EXPECT_TRUE(std::ranges::is_sorted(cpus));
  EXPECT_THAT(run({"nproc"}).lines, ElementsAre(std::to_string(cpus.size())));
}

TEST(Cpus, AChildExecutesWhereItIsBound) {
  const int cpu = allowed_cpus().back();
  sigset_t none;
  sigemptyset(&none);
  Child child = start({"grep", "Cpus_allowed_list", "/proc/self/status"}, none, {cpu});
  waitpid(child.pid, nullptr, 0);
  std::vector<std::string> lines;
  read_lines(child, [&](std::string line) { lines.push_back(std::move(line)); });
  EXPECT_THAT(lines, ElementsAre(EndsWith("\t" + std::to_string(cpu))));
}

TEST(Cpus, AClaimIsOneProcesssUntilItEnds) {
  const TemporaryDirectory entries;  // the machine's own may be taken by a run beside this test
  std::filesystem::create_directory(entries / "cpu3");
  {
    const auto claim = claim_cpu(3, entries.path());
    ASSERT_TRUE(claim);
    EXPECT_FALSE(claim_cpu(3, entries.path()));
  }
  EXPECT_TRUE(claim_cpu(3, entries.path()));
  EXPECT_FALSE(claim_cpu(4, entries.path())) << "there is no such CPU";
}

TEST(Cpus, AWakeUpTakesTime) {
  const int cpu = allowed_cpus().front();
  EXPECT_GT(wake_up_round_trip(cpu, cpu).count(), 0);
  EXPECT_THROW(wake_up_round_trip(cpu, 1023), std::system_error);
}

}  // namespace
}  // namespace tachless::process
