#include "node/options.h"

#include <fmt/core.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <iostream>
#include <stdexcept>

#include "diagnostics/failure.h"
#include "process/this_process.h"

namespace tachless::node {

bool parse(CLI::App& program, int argc, const char* const* argv) {
  try {
    program.parse(argc, argv);
    return true;
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) {
      program.exit(error, std::cout, std::cerr);
      return false;
    }
    throw diagnostics::bad_usage("{}; see {} --help", error.what(), program.get_name());
  }
}

std::string find_scenario(const std::string& given) {
  namespace fs = std::filesystem;
  std::error_code error;
  if (given.empty() || fs::exists(given, error)) return given;
  const fs::path folder = process::shared_directory() / "scenarios";
  fs::path name = given;
  if (*name.begin() == "scenarios") name = name.lexically_relative("scenarios");
  if (!name.has_extension()) name += ".yaml";
  const fs::path installed = folder / name;  // `given` itself, if that is absolute
  if (fs::exists(installed, error)) return installed.string();
  throw diagnostics::bad_usage("{}: no such file; looked for here and in {}", given,
                               folder.string());
}

CLI::Option* with_installed_scenarios(CLI::Option* files) {
  return files->transform(find_scenario);
}

void add_overrides(CLI::App& command, std::vector<std::string>& overrides) {
  command
      .add_option("--set", overrides,
                  "key.path=value, in place of the scenario's value; may be repeated")
      ->allow_extra_args(false);
}

CLI::Option* add_scenario(CLI::App& command, std::filesystem::path& path,
                          std::vector<std::string>& overrides) {
  add_overrides(command, overrides);
  return command.add_option("SCENARIO", path, "The experiment, a YAML file")->required();
}

void add_lcm_url(CLI::App& command, std::string& url) {
  command.add_option("--lcm-url", url, "The bus")
      ->envname("LCM_DEFAULT_URL")
      ->capture_default_str();
}

bus::LcmUrl parse_lcm_url(const std::string& url) {
  try {
    return bus::parse_lcm_url(url);
  } catch (const std::invalid_argument& problem) {
    throw diagnostics::bad_usage(std::string("--lcm-url: ") + problem.what());
  }
}

void add_key_file(CLI::App& command, std::string& path) {
  command
      .add_option("--key-file", path,
                  "Key of the bus, the same for all: 32 random bytes or 64 hexadecimal digits; "
                  "only who has it is heard")
      ->envname("TACHLESS_KEY_FILE")
      ->check([](const std::string& value) {
        return value.empty() ? "empty; name the key's file, or leave --key-file out"
                             : std::string();
      });
}

CLI::Option* add_run_id(CLI::App& command, const std::string& name, std::int64_t& run_id,
                        const std::string& description) {
  return command.add_option(name, run_id, description)
      ->check(CLI::Range(std::int64_t{1}, std::int64_t{9'000'000'000'000'000}));
}

}  // namespace tachless::node
