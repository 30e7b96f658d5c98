#include "diagnostics/logging.h"

#include <gtest/gtest.h>

#include <string>

namespace tachless::diagnostics {
namespace {

std::string shown_at(Verbosity verbosity) {
  ::testing::internal::CaptureStderr();
  start_logging("tachless-plant", verbosity);
  log_detail("detail");
  log_info("info {}");
  log_warning("warning");
  log_error("error");
  return ::testing::internal::GetCapturedStderr();
}

TEST(Logging, NamesTheProgramAndShowsWhatWasAskedFor) {
  const std::string serious = "tachless-plant: warning\ntachless-plant: error\n";
  EXPECT_EQ(shown_at(Verbosity::quiet), serious);
  EXPECT_EQ(shown_at(Verbosity::normal), "tachless-plant: info {}\n" + serious);
  EXPECT_EQ(shown_at(Verbosity::verbose),
            "tachless-plant: detail\ntachless-plant: info {}\n" + serious);
}

}  // namespace
}  // namespace tachless::diagnostics
