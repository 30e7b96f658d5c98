#include "report/report.h"

#include <fmt/format.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>

#include "diagnostics/failure.h"
#include "diagnostics/file_text.h"
#include "diagnostics/logging.h"
#include "diagnostics/unfinished_file.h"
#include "report/gnuplot.h"
#include "report/page_scripts.h"
#include "report/report_charts.h"
#include "report/report_page.h"

namespace tachless::report {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view remedy = "name another place with -o";

/// A directory beside `file`, for what the file is made of: where it can be written, so can this.
class WorkDirectory {
 public:
  explicit WorkDirectory(const fs::path& file) {
    std::string pattern = file.string() + ".XXXXXX";
    if (mkdtemp(pattern.data()) == nullptr) {
      throw diagnostics::bad_usage("{}: cannot be written: {}; {}", file.string(),
                                   std::strerror(errno), remedy);
    }
    path_ = pattern;
  }
  WorkDirectory(const WorkDirectory&) = delete;
  WorkDirectory& operator=(const WorkDirectory&) = delete;
  ~WorkDirectory() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
  }
  [[nodiscard]] const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

Drawings drawings_of(const std::vector<Chart>& charts, const fs::path& html) {
  if (charts.empty()) return {};
  const WorkDirectory directory(html);
  draw(chart_commands(charts, directory.path()), directory.path() / "report");
  Drawings drawings;
  for (const Chart& chart : charts) {
    drawings[chart.name] =
        diagnostics::file_text(directory.path() / (chart.name + ".svg")).value_or("");
  }
  return drawings;
}

}  // namespace

void write_report(const std::vector<RecordedRun>& runs, const fs::path& html,
                  const Libraries& libraries) {
  const std::vector<ReportSection> sections = report_sections(runs);
  const Drawings drawings = drawings_of(drawn_charts(sections), html);
  Html scripts;
  const Overlay all(runs, Detail::screen);
  if (libraries.missing.empty()) {
    scripts = page_scripts(libraries, page_data(all, report_sections(runs, Detail::screen)));
  } else {
    diagnostics::log_warning(
        "{} stands still, because {} cannot be read; to have a report that moves, type: apt-get "
        "install libjs-dygraphs libjs-three",
        html.string(), libraries.missing);
  }
  diagnostics::UnfinishedFile(html, remedy).write(report_page(runs, sections, drawings, scripts));
}

}  // namespace tachless::report
