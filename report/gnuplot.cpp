#include "report/gnuplot.h"

#include <fmt/format.h>

#include <fstream>
#include <iterator>
#include <regex>
#include <system_error>

#include "diagnostics/failure.h"
#include "diagnostics/file_text.h"
#include "diagnostics/text.h"
#include "process/child.h"

namespace tachless::report {

std::string gnuplot_string(std::string_view text) {
  std::string quoted = "'";
  for (const char c : text) {
    if (c == '\'') quoted += '\'';
    quoted += c;
  }
  return quoted + "'";
}

std::string enhanced(std::string_view text) {
  constexpr std::string_view special = "_^{}@&~\\";
  std::string escaped;
  for (const char c : text) {
    if (special.find(c) != std::string_view::npos) escaped += '\\';
    escaped += static_cast<unsigned char>(c) < ' ' ? ' ' : c;
  }
  return escaped;
}

std::string gnuplot_text(std::string_view text) { return gnuplot_string(enhanced(text)); }

std::string indexed(std::string_view symbol, std::size_t joint, std::string_view name) {
  std::string text = fmt::format("{{/:Italic {}}}_{{{}}}", symbol, joint + 1);
  if (name.empty()) return text;
  constexpr std::size_t longest = 18;
  const bool cut = name.size() > longest;  // its end is what tells joints apart
  if (cut) name.remove_prefix(name.size() - longest + 1);
  while (cut && diagnostics::utf8_length(name) == 0) name.remove_prefix(1);
  return text + fmt::format(" {{/=11 {}{}}}", cut ? "…" : "", enhanced(name));
}

void Plot::add(std::string_view rows, std::string_view how) {
  const std::size_t i = curves_.size();
  // gnuplot refuses a block without a row.
  fmt::format_to(std::back_inserter(blocks_), "$d{} << END\n{}nan nan\nEND\n", i, rows);
  curves_.push_back(fmt::format("$d{} {}", i, how));
}

std::string Plot::commands(std::string_view before) const {
  return fmt::format("{}{}plot {}\n", blocks_, before, fmt::join(curves_, ", "));
}

std::string titled(std::string_view title) {
  return title.empty() ? "notitle" : "title " + gnuplot_text(title);
}

std::string gnuplot_complaint(const std::vector<std::string>& lines) {
  // "FILE" line 3: cannot open file
  static const std::regex located(R"(^".*" line [0-9]+: *(.*)$)");
  std::string last = "it gave no reason";
  for (const std::string& line : lines) {
    std::smatch match;
    if (std::regex_match(line, match, located)) return diagnostics::one_line(match[1].str());
    if (const std::string text = diagnostics::one_line(line); !text.empty()) last = text;
  }
  return last;
}

void draw(const std::string& commands, const std::filesystem::path& svg) {
  const std::filesystem::path script = svg.string() + ".gnuplot";
  std::ofstream(script) << "set output " << gnuplot_string(svg.string()) << "\n" << commands;
  process::Finished gnuplot;
  try {
    gnuplot = process::run({"gnuplot", script.string()});
  } catch (const diagnostics::Failure&) {
    std::filesystem::remove(script);
    throw diagnostics::bad_usage(
        "figures need gnuplot, which is not installed; type: "
        "apt-get install gnuplot-nox");
  }
  std::error_code ignored;
  std::filesystem::remove(script, ignored);
  if (!gnuplot.well()) {
    throw diagnostics::bad_usage("gnuplot did not draw {}: {}", svg.string(),
                                 gnuplot_complaint(gnuplot.lines));
  }
}

void draw_file(const std::string& commands, const std::filesystem::path& svg,
               std::string_view remedy) {
  diagnostics::UnfinishedFile unfinished(svg, remedy);
  draw(commands, unfinished.name());
  unfinished.finish();
}

}  // namespace tachless::report
