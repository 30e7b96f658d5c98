#include "node/link.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>

#include "diagnostics/failure.h"

namespace tachless::node {
namespace {

using namespace std::chrono_literals;
using ::testing::AllOf;
using ::testing::HasSubstr;
using Time = loop::Clock::time_point;

constexpr Time start{1h};

loop::Participant the_plant() {
  loop::Participant plant;
  plant.role = loop::Role::plant;
  plant.pid = 42;
  plant.host = "arm-1";
  return plant;
}

/// What `check` says at `at`, after `number` announcements at `start`; empty when it says nothing.
std::string said(KeyCheck check, bool tagged, int number, Time at) {
  for (int i = 0; i < number; ++i) check.foreign({tagged, the_plant(), "10.0.0.2:4123"}, start);
  try {
    check.poll(at);
  } catch (const diagnostics::Failure& failure) {
    EXPECT_EQ(failure.code(), diagnostics::ExitCode::protocol_violated);
    return failure.what();
  }
  return {};
}

TEST(KeyCheck, NamesTheProcessWithTheOtherKeyAndTheRemedy) {
  const KeyCheck with_key(loop::Role::controller, true);
  EXPECT_THAT(said(with_key, true, 5, start + 1500ms),
              AllOf(HasSubstr("the plant (process 42 on arm-1, 10.0.0.2:4123)"),
                    HasSubstr("has another key than this controller;"), HasSubstr("--key-file")));
  EXPECT_THAT(said(with_key, false, 5, start + 1500ms), HasSubstr("has no key, this controller;"));
  EXPECT_THAT(said(KeyCheck(loop::Role::controller, false), true, 5, start + 2s),
              HasSubstr("has a key, this controller has none;"));
}

TEST(KeyCheck, NeedsFiveAnnouncementsAndOneAndAHalfSeconds) {
  const KeyCheck check(loop::Role::controller, true);
  EXPECT_EQ(said(check, true, 0, start + 10s), "");
  EXPECT_EQ(said(check, true, 4, start + 10s), "");
  EXPECT_EQ(said(check, true, 5, start + 1499ms), "");
  EXPECT_NE(said(check, true, 5, start + 1500ms), "");
}

TEST(KeyCheck, IsContentOnceAnAnnouncementHasVerified) {
  KeyCheck check(loop::Role::controller, true);
  check.accepted();
  EXPECT_EQ(said(check, true, 100, start + 1h), "");
}

}  // namespace
}  // namespace tachless::node
