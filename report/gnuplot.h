#pragma once

#include <array>
#include <filesystem>
#include <string>

/// What every figure needs of gnuplot.
namespace tachless::report {

/// Okabe and Ito's palette: told apart by people with any colour vision.
inline constexpr std::array<const char*, 7> palette = {"#0072B2", "#D55E00", "#009E73", "#CC79A7",
                                                       "#E69F00", "#56B4E9", "#000000"};

/// A gnuplot string literal of exactly these characters.
std::string gnuplot_string(const std::string& text);

/// The same for text that is shown, where gnuplot's enhanced mode gives a meaning to some
/// characters. Line ends and other control characters become spaces.
std::string gnuplot_text(const std::string& text);

std::string gnuplot_number(double value);

/// Has gnuplot carry out `gnuplot_commands`, which draw into `svg` (and into other files, should
/// they say so).
/// @throw diagnostics::Failure(bad_usage) when gnuplot cannot be started or refuses.
void draw(const std::string& gnuplot_commands, const std::filesystem::path& svg);

}  // namespace tachless::report
