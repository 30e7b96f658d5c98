#pragma once

#include <gtest/gtest.h>

#include <array>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "tests/support/program.h"

namespace tachless::system_test {

inline const std::string scenarios = TACHLESS_SOURCE_DIR "/scenarios/";
inline constexpr std::array roles{"logger", "controller", "reference", "plant"};

/// The four programs on one scenario of the tree, each with its counters in a file.
class FourPrograms {
 public:
  explicit FourPrograms(std::string scenario, std::vector<std::string> options = {"--run-id", "7"})
      : scenario_(std::move(scenario)), plant_options_(std::move(options)) {}

  Program& start(const std::string& role, std::vector<std::string> more = {}) {
    std::vector<std::string> arguments{scenarios + scenario_, "--wait-s", "30"};
    arguments.insert(arguments.end(), settings.begin(), settings.end());
    arguments.insert(arguments.end(), more.begin(), more.end());
    if (role == "plant") {
      arguments.insert(arguments.end(), plant_options_.begin(), plant_options_.end());
    }
    arguments.insert(arguments.end(), {"--stats", statistics_path(role)});
    if (role == "logger") arguments.insert(arguments.end(), {"--out-log", log_path()});
    const std::string program = role == "plant" ? plant : "tachless-" + role;
    programs_[role] = std::make_unique<Program>(program, arguments, directory_.path());
    return *programs_[role];
  }
  void start_all() {
    for (const char* role : roles) start(role);
  }
  Program& operator[](const std::string& role) { return *programs_.at(role); }
  [[nodiscard]] std::string log_path() const {
    return log.empty() ? (directory_ / "lcmlog").string() : log;
  }
  [[nodiscard]] std::string statistics_path(const std::string& role) const {
    return directory_ / (role + ".json");
  }
  [[nodiscard]] std::uintmax_t log_size() const {
    std::error_code absent;
    const auto size = std::filesystem::file_size(log_path(), absent);
    return absent ? 0 : size;
  }
  [[nodiscard]] const TemporaryDirectory& directory() const { return directory_; }

  void expect_all_done() {
    for (const char* role : roles) {
      EXPECT_EQ((*this)[role].wait(), 0) << role << ": " << (*this)[role].errors();
    }
  }

  std::string plant = "tachless-plant";  ///< the program in the plant's place
  std::string log;                       ///< where it goes, if not into the directory
  std::vector<std::string> settings{"--set", "loop.duration_s=0.02"};  // 400 ticks of paper_rigid

 private:
  TemporaryDirectory directory_;
  std::string scenario_;
  std::vector<std::string> plant_options_;
  std::map<std::string, std::unique_ptr<Program>> programs_;
};

}  // namespace tachless::system_test
