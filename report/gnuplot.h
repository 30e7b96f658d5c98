#pragma once

#include <array>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

/// gnuplot: literals in its language, and running it. What is drawn: chart.h.
namespace tachless::report {

/// Okabe and Ito's palette: told apart by people with any colour vision.
inline constexpr std::array<const char*, 7> palette = {"#0072B2", "#D55E00", "#009E73", "#CC79A7",
                                                       "#E69F00", "#56B4E9", "#000000"};

/// A gnuplot string literal of exactly these characters.
std::string gnuplot_string(std::string_view text);

/// Text that is shown, where gnuplot's enhanced mode gives a meaning to some characters. Line ends
/// and other control characters become spaces.
std::string enhanced(std::string_view text);

/// The same as a string literal.
std::string gnuplot_text(std::string_view text);

/// Has gnuplot carry out `commands`, which draw into `svg` (and into other files, should they say
/// so). A file beside `svg` holds the commands meanwhile.
/// @throw diagnostics::Failure(bad_usage) when gnuplot cannot be started or refuses, with its first
/// line that says why
void draw(const std::string& commands, const std::filesystem::path& svg);

/// Of what gnuplot wrote when it refused, the line that says why: the others repeat the command
/// that was refused, point at a place in it, or are empty.
std::string gnuplot_complaint(const std::vector<std::string>& lines);

}  // namespace tachless::report
