#include "launch/placement.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <set>
#include <string>
#include <vector>

#include "diagnostics/failure.h"
#include "process/cpus.h"

namespace tachless::launch {
namespace {

using experiment::Mode;
using loop::Role;
using ::testing::AnyOf;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::StartsWith;

const int first = process::allowed_cpus().front();
const int last = process::allowed_cpus().back();

std::string refusal(const std::string& wanted) {
  try {
    choose_placement(wanted, Mode::lockstep);
  } catch (const diagnostics::Failure& failure) {
    EXPECT_EQ(failure.code(), diagnostics::ExitCode::bad_usage);
    return failure.what();
  }
  return "none";
}

TEST(Placement, TogetherLeavesTheOtherCpusToTheLogger) {
  const Placement placement = choose_placement("together", Mode::lockstep);
  ASSERT_EQ(placement.cpus_of(Role::plant).size(), 1U);
  EXPECT_EQ(placement.cpus_of(Role::plant), placement.cpus_of(Role::controller));
  EXPECT_EQ(placement.cpus_of(Role::plant), placement.cpus_of(Role::reference));
  if (first != last) {
    EXPECT_THAT(placement.cpus_of(Role::logger),
                Not(Contains(placement.cpus_of(Role::plant).front())));
  }
  EXPECT_FALSE(placement.spin);
}

// Runs beside this test have CPUs of their own, and come and go.
TEST(Placement, RunsTogetherShareNoCpuThatTheyClaimAndSayWhenNoneIsLeft) {
  std::vector<Placement> placements;
  std::set<int> claimed;
  for (std::size_t i = 0; i <= process::allowed_cpus().size(); ++i) {
    const Placement& placement =
        placements.emplace_back(choose_placement("together", Mode::lockstep));
    if (placement.claims.empty()) {
      EXPECT_THAT(placement.words, HasSubstr(", which another run has, too"));
      continue;
    }
    ASSERT_EQ(placement.cpus_of(Role::plant).size(), 1U);
    const int cpu = placement.cpus_of(Role::plant).front();
    EXPECT_EQ(placement.words, "together on CPU " + std::to_string(cpu));
    EXPECT_TRUE(claimed.insert(cpu).second);
  }
  EXPECT_TRUE(placements.back().claims.empty());
}

TEST(Placement, SpreadAndRealtimeLeaveItToTheKernel) {
  for (const Placement& placement :
       {choose_placement("spread", Mode::lockstep), choose_placement("auto", Mode::realtime)}) {
    EXPECT_EQ(placement.words, "spread over CPUs");
    for (const auto& cpus : placement.cpus) EXPECT_THAT(cpus, IsEmpty());
  }
}

TEST(Placement, ByItselfSaysWhatItMeasured) {
  const Placement placement = choose_placement("auto", Mode::lockstep);
  EXPECT_THAT(placement.words, AnyOf(StartsWith("together on CPU "), "spread over CPUs"));
  EXPECT_THAT(placement.reason, AnyOf(HasSubstr(" µs on two"), "there is one CPU"));
}

TEST(Placement, TakesCpusByNumber) {
  const std::string a = std::to_string(first);
  const std::string b = std::to_string(last);
  const Placement one = choose_placement(a, Mode::lockstep);
  for (const auto& cpus : one.cpus) EXPECT_THAT(cpus, ElementsAre(first));
  const Placement two = choose_placement(a + "," + b, Mode::realtime);
  EXPECT_THAT(two.cpus_of(Role::reference), ElementsAre(first));
  EXPECT_THAT(two.cpus_of(Role::logger), ElementsAre(last));
  const Placement four = choose_placement(a + "," + b + "," + a + "," + b, Mode::lockstep);
  EXPECT_THAT(four.cpus_of(Role::plant), ElementsAre(first));
  EXPECT_THAT(four.cpus_of(Role::controller), ElementsAre(last));
  EXPECT_THAT(four.cpus_of(Role::reference), ElementsAre(first));
  EXPECT_THAT(four.cpus_of(Role::logger), ElementsAre(last));
}

TEST(Placement, IsRefusedWithWhatIsAllowed) {
  for (const char* wanted : {"fast", "", "0,", "1x", "-1", "0;1"}) {
    EXPECT_THAT(refusal(wanted), AnyOf(HasSubstr("auto, spread, together, spin, or numbers"),
                                       HasSubstr("may use; allowed:")))
        << wanted;
  }
  EXPECT_THAT(refusal("4000"), HasSubstr("--placement 4000: CPU 4000 is none"));
  const std::string cpu = std::to_string(first);
  EXPECT_THAT(refusal(cpu + "," + cpu + "," + cpu), HasSubstr("one CPU for all, two ("));
}

TEST(Placement, SpinNeedsFourCpus) {
  if (process::allowed_cpus().size() < 4) {
    EXPECT_THAT(refusal("spin"), HasSubstr("type: --placement together"));
    return;
  }
  const Placement placement = choose_placement("spin", Mode::lockstep);
  EXPECT_TRUE(placement.spin);
  EXPECT_NE(placement.cpus_of(Role::plant), placement.cpus_of(Role::controller));
  EXPECT_THAT(refusal("spin"), AnyOf("none", HasSubstr("other runs have them")));
}

}  // namespace
}  // namespace tachless::launch
