#pragma once

#include <CLI/App.hpp>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "bus/lcm_url.h"

/// Options that several programs and verbs have: declared once, so that they are the same
/// everywhere.
namespace tachless::node {

inline constexpr const char* default_lcm_url = "udpm://239.255.76.67:7667?ttl=0";

/// Reads a program's command line. False when --help or --version was asked for, which has then
/// been answered on stdout.
/// @throw Failure(bad_usage), one line
bool parse(CLI::App& program, int argc, const char* const* argv);

/// The scenario or URDF file that is meant: `given` where there is one; else one of the
/// installation, by its path in scenarios/, with or without this word and .yaml.
/// @throw Failure(bad_usage) naming both places, when there is none
std::string find_scenario(const std::string& given);
/// For an option or argument with such files. @return the same option
CLI::Option* with_installed_scenarios(CLI::Option* files);

/// --set for the values of scenarios.
void add_overrides(CLI::App& command, std::vector<std::string>& overrides);
/// SCENARIO, and --set for its values. @return the first
CLI::Option* add_scenario(CLI::App& command, std::filesystem::path& path,
                          std::vector<std::string>& overrides);

/// --lcm-url, else LCM_DEFAULT_URL, else what `url` is before.
void add_lcm_url(CLI::App& command, std::string& url);
/// @throw Failure(bad_usage) naming --lcm-url
bus::LcmUrl parse_lcm_url(const std::string& url);

/// --key-file, else TACHLESS_KEY_FILE; empty when there is none.
void add_key_file(CLI::App& command, std::string& path);

/// An option that is a run's id: a positive number.
CLI::Option* add_run_id(CLI::App& command, const std::string& name, std::int64_t& run_id,
                        const std::string& description);

}  // namespace tachless::node
