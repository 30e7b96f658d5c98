#pragma once

#include <array>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

/// gnuplot: literals in its language, plots of data, and running it. What is drawn: chart.h.
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

/// Enhanced text for a symbol with a joint's number, and its name if that is given: q_1 shoulder.
/// Of a long name its end.
std::string indexed(std::string_view symbol, std::size_t joint, std::string_view name = {});

/// A `plot` command and the blocks of data that it draws.
class Plot {
 public:
  /// @param rows of numbers, each with its line end; may be empty
  /// @param how what follows the data in gnuplot's command: "with lines title 'q'"
  void add(std::string_view rows, std::string_view how);
  /// What is no data: a function, an entry of the key alone.
  void add(std::string expression) { curves_.push_back(std::move(expression)); }

  [[nodiscard]] bool empty() const { return curves_.empty(); }
  /// The blocks, `before`, and the command, each with its line end.
  [[nodiscard]] std::string commands(std::string_view before = {}) const;

 private:
  std::string blocks_;
  std::vector<std::string> curves_;
};

/// `title` as an entry of the key; none when it is empty.
std::string titled(std::string_view title);

/// Has gnuplot carry out `commands`, which draw into `svg`: one picture, or several one after the
/// other (each begins with its own `set terminal`). A file beside `svg` holds the commands
/// meanwhile.
/// @throw diagnostics::Failure(bad_usage) when gnuplot cannot be started or refuses, with its first
/// line that says why
void draw(const std::string& commands, const std::filesystem::path& svg);

/// The same for a file that appears when it is whole.
/// @param remedy as diagnostics::UnfinishedFile
void draw_file(const std::string& commands, const std::filesystem::path& svg,
               std::string_view remedy);

/// Of what gnuplot wrote when it refused, the line that says why: the others repeat the command
/// that was refused, point at a place in it, or are empty.
std::string gnuplot_complaint(const std::vector<std::string>& lines);

}  // namespace tachless::report
