#include "cli/supervise.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include "base/failure.h"
#include "base/this_process.h"

namespace tachless::cli {
namespace {

using messages::Role;
using scenario::Mode;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

TEST(Placement, PutsTheLoopOnOneCpuAndTheLoggerOnTheOthers) {
  const Placement placement = choose_placement("auto", Mode::lockstep, 0);
  if (base::allowed_cpus().size() == 1) {
    EXPECT_EQ(placement.words, "spread over CPUs");
    return;
  }
  ASSERT_EQ(placement.cpus_of(Role::plant).size(), 1U);
  const int cpu = placement.cpus_of(Role::plant).front();
  EXPECT_EQ(placement.words, "together on CPU " + std::to_string(cpu));
  EXPECT_EQ(placement.cpus_of(Role::controller), placement.cpus_of(Role::plant));
  EXPECT_EQ(placement.cpus_of(Role::reference), placement.cpus_of(Role::plant));
  EXPECT_THAT(placement.cpus_of(Role::logger), Not(Contains(cpu)));
  EXPECT_THAT(placement.cpus_of(Role::logger), Not(IsEmpty()));
  EXPECT_NE(choose_placement("auto", Mode::lockstep, 1).cpus_of(Role::plant).front(), cpu)
      << "a second robot of the run";
}

TEST(Placement, NoneAndRealtimeLeaveItToTheKernel) {
  for (const Placement& placement :
       {choose_placement("none", Mode::lockstep, 0), choose_placement("auto", Mode::realtime, 0)}) {
    EXPECT_EQ(placement.words, "spread over CPUs");
    for (const auto& cpus : placement.cpus) EXPECT_THAT(cpus, IsEmpty());
  }
}

TEST(Placement, IsRefusedWithWhatIsAllowed) {
  for (const char* wanted : {"together", "spread", "spin", "", "0", "0,1"}) {
    try {
      choose_placement(wanted, Mode::lockstep, 0);
      FAIL() << wanted;
    } catch (const base::Failure& failure) {
      EXPECT_EQ(failure.code(), base::ExitCode::bad_usage);
      EXPECT_THAT(failure.what(), HasSubstr("allowed: auto, none"));
    }
  }
}

}  // namespace
}  // namespace tachless::cli
