#pragma once

#include <cstddef>
#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <string>

/// Summary of an LCM log, which may be damaged or written by another program.
namespace tachless::logger {

/// Number of channels listed one by one. Messages on further channels are counted together.
inline constexpr std::size_t max_channels = 1000;

/// Returns the file, its damage, its channels by name, and the recorded run, or the reason why the
/// file has no run. Times are event time stamps [us]. Texts from the log are made valid UTF-8.
/// @throw base::Failure(bad_usage) when `path` is not a readable file, or is not empty and has no
/// message. The failure then names the kind of file, if its beginning shows it.
nlohmann::json read_info(const std::filesystem::path& path);

/// Returns the summary as a few lines and a table.
std::string to_text(const nlohmann::json& info);

}  // namespace tachless::logger
