#include "base/logging.h"

#include <fmt/format.h>
#include <spdlog/sinks/ansicolor_sink.h>
#include <spdlog/spdlog.h>

#include <cstdio>
#include <cstdlib>
#include <memory>
#include <string>
#include <string_view>

#include "base/text.h"

namespace tachless::base {
namespace {

/// spdlog makes its registry at the first use. This first use is before main, so that no two
/// threads meet in it: a thread sanitizer cannot see how spdlog's own library guards it.
[[maybe_unused]] const spdlog::logger* const registry_is_made = spdlog::default_logger_raw();

/// Returns a line for people. A line that quotes a long text keeps its begin and its end, where the
/// remedy stands.
std::string shown(std::string_view line) {
  constexpr std::size_t longest = 6000, begin = 4000;
  if (line.size() <= longest) return printable(line);
  return fmt::format("{} [... {} characters ...] {}", printable(line.substr(0, begin)),
                     line.size() - longest, printable(line.substr(line.size() - longest + begin)));
}

}  // namespace

void start_logging(std::string_view program, Verbosity verbosity, Marks marks) {
  // Warnings and errors in colour, on a terminal that has any (https://no-color.org).
  const bool plain = std::getenv("NO_COLOR") != nullptr;
  auto sink = std::make_shared<spdlog::sinks::ansicolor_stderr_sink_mt>(
      plain ? spdlog::color_mode::never : spdlog::color_mode::automatic);
  sink->set_color(spdlog::level::info, "");
  auto logger = std::make_shared<spdlog::logger>(std::string(program), std::move(sink));
  logger->set_pattern(marks == Marks::levels ? "<%l> %n: %v" : "%^%n:%$ %v");
  logger->set_level(verbosity == Verbosity::quiet    ? spdlog::level::warn
                    : verbosity == Verbosity::normal ? spdlog::level::info
                                                     : spdlog::level::debug);
  logger->flush_on(spdlog::level::debug);
  spdlog::set_default_logger(std::move(logger));
}

// "{}" keeps a brace in a line from being read as a format.
void log_detail(std::string_view line) { spdlog::debug("{}", shown(line)); }
void log_info(std::string_view line) { spdlog::info("{}", shown(line)); }
void log_warning(std::string_view line) { spdlog::warn("{}", shown(line)); }
void log_error(std::string_view line) { spdlog::error("{}", shown(line)); }

void pass_on(std::string_view line) {
  const std::string text = fmt::format("{}\n", shown(line));
  std::fwrite(text.data(), 1, text.size(), stderr);
}

}  // namespace tachless::base
