#include <fmt/format.h>

#include <filesystem>
#include <iostream>
#include <memory>
#include <string>
#include <system_error>

#include "launch/verb.h"
#include "process/installation.h"

namespace tachless::launch::verb {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void refuse(const fs::path& directory, const std::string& why) {
  throw diagnostics::bad_usage("init {}: {}; name another directory", directory.string(), why);
}

diagnostics::ExitCode make_project(const fs::path& directory) {
  std::error_code error;
  fs::create_directories(directory, error);
  if (error || !fs::is_directory(directory)) {
    refuse(directory, "cannot be made a directory" + (error ? ": " + error.message() : ""));
  }
  const bool empty = fs::is_empty(directory, error);
  if (error) refuse(directory, error.message());
  if (!empty) refuse(directory, "is not empty");
  for (const auto& file : fs::directory_iterator(process::shared_directory() / "project")) {
    const fs::path copy = directory / file.path().filename();
    fs::copy_file(file.path(), copy, error);
    if (error) refuse(directory, fmt::format("{}: {}", copy.string(), error.message()));
    std::cout << copy.string() << '\n';
  }
  std::cout << fmt::format("To begin: cd {} && tachless run arm.yaml\n", directory.string());
  return diagnostics::ExitCode::done;
}

Verb::Action declare(CLI::App& command) {
  auto directory = std::make_shared<fs::path>();
  command.add_option("DIR", *directory, "A new directory, or an empty one")->required();
  return [directory] { return make_project(*directory); };
}

}  // namespace

extern const Verb init;
const Verb init = {"init", "A project to begin with: a robot, a scenario, what to type",
                   "  tachless init my_arm", declare};

}  // namespace tachless::launch::verb
