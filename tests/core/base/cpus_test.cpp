#include "base/this_process.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "base/child.h"

namespace tachless::base {
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
  StartOptions bound;
  bound.cpus = {cpu};
  Child child = start({"grep", "Cpus_allowed_list", "/proc/self/status"}, bound);
  waitpid(child.pid, nullptr, 0);
  std::vector<std::string> lines;
  read_lines(child, [&](std::string line) { lines.push_back(std::move(line)); });
  EXPECT_THAT(lines, ElementsAre(EndsWith("\t" + std::to_string(cpu))));
}

}  // namespace
}  // namespace tachless::base
