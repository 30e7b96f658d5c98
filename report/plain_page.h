#pragma once

#include <filesystem>
#include <functional>
#include <string>

#include "report/html.h"

namespace tachless::report {

/// Writes a page of a study: title, `body`, the scenario's text; one file that needs nothing else.
/// @throw diagnostics::Failure(bad_usage) when it cannot be written
void write_plain_page(const std::filesystem::path& html, const std::string& title, const Html& body,
                      const std::string& scenario);

/// An SVG that gnuplot draws from these commands into `svg`, as it is to stand in a page.
/// @param commands for the name of the file that they are to draw into
/// @throw diagnostics::Failure(bad_usage) when gnuplot cannot draw
Html drawn_figure(const std::filesystem::path& svg,
                  const std::function<std::string(const std::filesystem::path&)>& commands,
                  const std::string& caption);

}  // namespace tachless::report
