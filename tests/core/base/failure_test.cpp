#include "base/failure.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cerrno>
#include <new>

namespace tachless::base {
namespace {

using ::testing::HasSubstr;

TEST(Failure, IsOneLineAndKeepsItsCode) {
  const Failure failure(ExitCode::bad_usage, "a.yaml: robot\n\x1B[2Jx: unknown key\n");
  EXPECT_STREQ(failure.what(), "a.yaml: robot [2Jx: unknown key");
  EXPECT_EQ(failure.code(), ExitCode::bad_usage);
}

Failure refused(int error, const char* call) {
  return system_failure(std::system_error(error, std::generic_category(), call));
}

TEST(SystemFailure, NamesCallCauseAndRemedy) {
  EXPECT_EQ(refused(EMFILE, "pipe2").code(), ExitCode::bad_usage);
  EXPECT_STREQ(refused(EMFILE, "pipe2").what(),
               "system error: pipe2: Too many open files; allow more open files, for example: "
               "ulimit -n 1024");
  EXPECT_THAT(refused(EAGAIN, "fork").what(), HasSubstr("ulimit -u"));
  EXPECT_THAT(refused(EIO, "signalfd").what(), HasSubstr("tachless doctor"));
}

template <class Thrown>
Failure current_failure_of(const Thrown& thrown) {
  try {
    throw thrown;
  } catch (...) {
    return current_failure();
  }
}

TEST(CurrentFailure, HasTheCodeThatTheProgramEndsWith) {
  const Failure stop(ExitCode::protective_stop, "drive 2 is too hot");
  EXPECT_EQ(current_failure_of(stop).code(), ExitCode::protective_stop);
  const Failure refusal =
      current_failure_of(std::system_error(ENOSPC, std::generic_category(), "write"));
  EXPECT_EQ(refusal.code(), ExitCode::bad_usage);
  EXPECT_THAT(refusal.what(), HasSubstr("system error: write: No space left on device"));
  EXPECT_EQ(current_failure_of(std::runtime_error("cable")).code(), ExitCode::protocol_violated);
  EXPECT_EQ(current_failure_of(42).code(), ExitCode::protocol_violated);
  const Failure memory = current_failure_of(std::bad_alloc());
  EXPECT_EQ(memory.code(), ExitCode::bad_usage);
  EXPECT_THAT(memory.what(), HasSubstr("ulimit -v unlimited"));
}

}  // namespace
}  // namespace tachless::base
