#include "diagnostics/failure.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cerrno>

namespace tachless::diagnostics {
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

}  // namespace
}  // namespace tachless::diagnostics
