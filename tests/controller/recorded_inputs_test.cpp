#include "controller/recorded_inputs.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "bus/wire.h"

namespace tachless::controller {
namespace {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

class InputsInALog : public ::testing::Test {
 protected:
  void TearDown() override { fs::remove(path_); }

  void measured(std::int64_t tick, std::int64_t run = 7) {
    log_.append(tick, "ARM_POSITION",
                measurement_.encode({tick, run, tick}, {robot::Vector::Constant(2, 0.25)}));
  }
  void referred(std::int64_t tick, std::int64_t run = 7) {
    loop::ReferencePoint reference;
    for (auto* each : {&reference.q_ref, &reference.v_ref, &reference.a_ref, &reference.jerk_ref,
                       &reference.snap_ref}) {
      *each = robot::Vector::Zero(2);
    }
    log_.append(tick, "ARM_REFERENCE", reference_.encode({tick, run, tick}, reference));
  }
  void other(std::int64_t tick) {
    log_.append(tick, "ARM_TRUTH", std::vector<std::byte>(3));  // unsound, and nobody looks at it
  }

  std::vector<std::int64_t> ticks() {
    log_.flush();
    inputs_.emplace(path_, "ARM_POSITION", "ARM_REFERENCE", 7);
    std::vector<std::int64_t> result;
    while (const auto tick = inputs_->next()) {
      EXPECT_EQ(bus::stamp_of(tick->measurement).tick, tick->tick);
      EXPECT_EQ(bus::stamp_of(tick->reference).tick, tick->tick);
      result.push_back(tick->tick);
    }
    return result;
  }

  fs::path path_ =
      fs::path(::testing::TempDir()) / ("inputs-" + std::to_string(getpid()) + "-lcmlog");
  logger::LogWriter log_{path_, logger::Existing::overwrite};
  loop::Layout layout_{.num_joints = 2, .num_motors = 0, .num_signals = 0};
  bus::Codec<loop::PositionMeasurement> measurement_{layout_};
  bus::Codec<loop::ReferencePoint> reference_{layout_};
  std::optional<RecordedInputs> inputs_;
};

TEST_F(InputsInALog, AreGivenTickByTickWithoutALookAtOtherChannels) {
  for (int k = 0; k < 4; ++k) {
    other(k);
    measured(k);
    referred(k);
  }
  EXPECT_THAT(ticks(), ElementsAre(0, 1, 2, 3));
  EXPECT_EQ(inputs_->next_tick(), 4);
}

TEST_F(InputsInALog, EndWhereOneOfTheTwoIsMissing) {
  measured(0);
  referred(0);
  measured(1);
  measured(2);
  referred(2);
  EXPECT_THAT(ticks(), ElementsAre(0));
}

TEST_F(InputsInALog, EndWhereATickIsMissing) {
  for (const int k : {0, 1, 3}) {
    measured(k);
    referred(k);
  }
  EXPECT_THAT(ticks(), ElementsAre(0, 1));
}

TEST_F(InputsInALog, BeginWithTickZeroOrNotAtAll) {
  measured(1);
  referred(1);
  EXPECT_THAT(ticks(), IsEmpty());
}

TEST_F(InputsInALog, AreNotTakenFromAnotherRun) {
  measured(0, 8);
  try {
    ticks();
    FAIL() << "accepted";
  } catch (const diagnostics::Failure& failure) {
    EXPECT_EQ(failure.code(), diagnostics::ExitCode::bad_usage);
    EXPECT_THAT(failure.what(), HasSubstr("cannot resume run 7"));
    EXPECT_THAT(failure.what(), HasSubstr("it is of run 8"));
  }
}

TEST_F(InputsInALog, EndAtAMessageTooShortForAStamp) {
  measured(0);
  referred(0);
  log_.append(1, "ARM_POSITION", std::vector<std::byte>(bus::stamp_end - 1));
  EXPECT_THAT(ticks(), ElementsAre(0));
}

}  // namespace
}  // namespace tachless::controller
