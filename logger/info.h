#pragma once

#include <cstddef>
#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <string>

/// What is in a log, at a glance: any LCM log, ours or not, damaged or not.
namespace tachless::logger {

/// Channels that are listed one by one; messages on further ones are counted together.
inline constexpr std::size_t max_channels = 1000;

/// For programs: the file, its damage, its channels by name, and the run that it recorded, or why
/// there is none. Times are event time stamps [us]. Texts from the log are made valid UTF-8.
/// @throw base::Failure(bad_usage) when `path` is not a readable file, or has not one
/// message in it without being empty: saying then what it is, as far as that shows.
nlohmann::json read_info(const std::filesystem::path& path);

/// The same for people: a few lines and a table.
std::string to_text(const nlohmann::json& info);

}  // namespace tachless::logger
