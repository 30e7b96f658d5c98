#include "logger/log_file.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <string>

#include "tests/support/temporary_directory.h"

namespace tachless::logger {
namespace {

namespace fs = std::filesystem;

class FindLog : public ::testing::Test {
 protected:
  fs::path run(const std::string& name) {
    fs::create_directories(directory_ / name);
    std::ofstream(directory_ / (name + "/lcmlog")) << "a log";
    return directory_ / (name + "/lcmlog");
  }
  fs::path runs() const { return directory_ / "arm"; }

  TemporaryDirectory directory_;
};

TEST_F(FindLog, AFileIsMeantItselfAndARunsDirectoryTheLogInIt) {
  const fs::path log = run("arm/2026-01-01-120000");
  EXPECT_EQ(find_log(log), log);
  EXPECT_EQ(find_log(log.parent_path()), log);
  EXPECT_EQ(find_log("/nowhere"), "/nowhere");
  EXPECT_EQ(find_log(directory_ / ""), directory_ / "lcmlog") << "which the reader will name";
}

TEST_F(FindLog, ADirectoryOfRunsMeansTheLinkedOneElseTheNewest) {
  const fs::path first = run("arm/2026-01-01-120000");
  const fs::path second = run("arm/2026-01-02-110000");
  fs::create_directories(runs() / "2026-01-03-110000");  // directory of a run that did not begin
  EXPECT_EQ(find_log(runs()), second);
  fs::create_directory_symlink("2026-01-01-120000", runs() / "latest");
  EXPECT_EQ(find_log(runs()), first);
  fs::remove_all(first.parent_path());
  EXPECT_EQ(find_log(runs()), second);
}

}  // namespace
}  // namespace tachless::logger
