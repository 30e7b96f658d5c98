#pragma once

#include <csignal>
#include <filesystem>
#include <string>
#include <vector>

#include "tests/support/program.h"

/// `tachless run` of a scenario that goes on until it is interrupted, in directory/out.
class EndlessRun {
 public:
  explicit EndlessRun(const TemporaryDirectory& directory,
                      const std::vector<std::string>& more = {},
                      const std::string& scenario = "practical_flexible")
      : log_(directory / "out/lcmlog"),
        program_("tachless", words(directory, more, scenario), directory.path()) {}

  /// Returns true if it has recorded some hundred ticks.
  [[nodiscard]] bool under_way() const {
    std::error_code error;
    const auto size = std::filesystem::file_size(log_, error);
    return !error && size > 200'000;
  }

  /// Ctrl-C; its exit code.
  int interrupt() {
    program_.signal(SIGINT);
    return program_.wait();
  }

  Program& program() { return program_; }

 private:
  static std::vector<std::string> words(const TemporaryDirectory& directory,
                                        const std::vector<std::string>& more,
                                        const std::string& scenario) {
    std::vector<std::string> all = {"run",
                                    TACHLESS_SOURCE_DIR "/scenarios/" + scenario + ".yaml",
                                    "--quiet",
                                    "--duration",
                                    "100000",
                                    "--out",
                                    directory / "out"};
    all.insert(all.end(), more.begin(), more.end());
    return all;
  }

  std::filesystem::path log_;
  Program program_;
};
