#pragma once

#include <fmt/core.h>

#include <string_view>
#include <utility>

/// Log lines for the user, on stderr: "tachless-plant: waiting for controller". Code that runs once
/// per tick never calls these functions: writing may block, and it allocates.
namespace tachless::base {

enum class Verbosity { quiet, normal, verbose };

/// Marks at the start of lines: none, or the level ("<error> ") for programs that parse the lines.
enum class Marks { none, levels };
inline constexpr std::string_view error_mark = "<error> ";
inline constexpr std::string_view warning_mark = "<warning> ";

/// Sets the program's name and the verbosity: quiet shows warnings and errors, normal also events
/// that happen once per run, verbose also details. Call it once, before the first line. Every line
/// is made printable (text.h).
void start_logging(std::string_view program, Verbosity verbosity, Marks marks = Marks::none);

void log_detail(std::string_view line);  ///< shown with --verbose
void log_info(std::string_view line);
void log_warning(std::string_view line);
void log_error(std::string_view line);

/// Formats the line with its arguments by fmt::format.
template <class First, class... Rest>
void log_detail(fmt::format_string<First, Rest...> line, First&& first, Rest&&... rest) {
  log_detail(fmt::format(line, std::forward<First>(first), std::forward<Rest>(rest)...));
}
template <class First, class... Rest>
void log_info(fmt::format_string<First, Rest...> line, First&& first, Rest&&... rest) {
  log_info(fmt::format(line, std::forward<First>(first), std::forward<Rest>(rest)...));
}
template <class First, class... Rest>
void log_warning(fmt::format_string<First, Rest...> line, First&& first, Rest&&... rest) {
  log_warning(fmt::format(line, std::forward<First>(first), std::forward<Rest>(rest)...));
}
template <class First, class... Rest>
void log_error(fmt::format_string<First, Rest...> line, First&& first, Rest&&... rest) {
  log_error(fmt::format(line, std::forward<First>(first), std::forward<Rest>(rest)...));
}

/// Prints a line of another program without a name before it, at every verbosity.
void pass_on(std::string_view line);

}  // namespace tachless::base
