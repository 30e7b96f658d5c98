#include "base/logging.h"

#include <gtest/gtest.h>

#include <string>

namespace tachless::base {
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

TEST(Logging, MarksErrorsAndWarningsForAProgramThatReadsThem) {
  ::testing::internal::CaptureStderr();
  start_logging("tachless-plant", Verbosity::quiet, Marks::levels);
  log_warning("late");
  log_error("lost");
  EXPECT_EQ(::testing::internal::GetCapturedStderr(),
            std::string(warning_mark) + "tachless-plant: late\n" + std::string(error_mark) +
                "tachless-plant: lost\n");
}

TEST(Logging, ShowsNoTerminalEscapesAndNoBytesThatAreNotUtf8) {
  ::testing::internal::CaptureStderr();
  start_logging("tachless", Verbosity::normal);
  log_warning("a \x1b[31mred\xc2\x9bK j\xf6rg");
  EXPECT_EQ(::testing::internal::GetCapturedStderr(), "tachless: a ?[31mred?K j?rg\n");
}

TEST(Logging, KeepsTheBeginAndTheEndOfALongLine) {
  ::testing::internal::CaptureStderr();
  start_logging("tachless", Verbosity::normal);
  log_error("table.csv: no such column; there are " + std::string(9'000'000, 'x') + "; name one");
  const std::string line = ::testing::internal::GetCapturedStderr();
  EXPECT_LT(line.size(), 7000U);
  EXPECT_EQ(line.substr(0, 23), "tachless: table.csv: no");
  EXPECT_EQ(line.substr(line.size() - 10), " name one\n");
}

}  // namespace
}  // namespace tachless::base
