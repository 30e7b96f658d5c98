#include "diagnostics/failure.h"

#include <gtest/gtest.h>

namespace tachless::diagnostics {
namespace {

TEST(Failure, IsOneLineAndKeepsItsCode) {
  const Failure failure(ExitCode::bad_usage, "a.yaml: robot\n\x1B[2Jx: unknown key\n");
  EXPECT_STREQ(failure.what(), "a.yaml: robot [2Jx: unknown key");
  EXPECT_EQ(failure.code(), ExitCode::bad_usage);
}

}  // namespace
}  // namespace tachless::diagnostics
