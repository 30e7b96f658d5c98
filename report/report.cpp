#include "report/report.h"

#include <fmt/format.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <sstream>

#include "diagnostics/failure.h"
#include "report/gnuplot.h"
#include "report/report_charts.h"
#include "report/report_page.h"

namespace tachless::report {
namespace {

namespace fs = std::filesystem;

class TemporaryDirectory {
 public:
  TemporaryDirectory() {
    std::string pattern = (fs::temp_directory_path() / "tachless-report-XXXXXX").string();
    if (mkdtemp(pattern.data()) == nullptr) {
      throw diagnostics::Failure(diagnostics::ExitCode::bad_usage,
                                 fmt::format("{}: cannot make this directory: {}; set TMPDIR to a "
                                             "place that is writable",
                                             pattern, std::strerror(errno)));
    }
    path_ = pattern;
  }
  TemporaryDirectory(const TemporaryDirectory&) = delete;
  TemporaryDirectory& operator=(const TemporaryDirectory&) = delete;
  ~TemporaryDirectory() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
  }
  [[nodiscard]] const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

Drawings drawings_of(const std::vector<Chart>& charts) {
  if (charts.empty()) return {};
  const TemporaryDirectory directory;
  draw(chart_commands(charts, directory.path()), directory.path() / "report");
  Drawings drawings;
  for (const Chart& chart : charts) {
    std::ostringstream text;
    text << std::ifstream(directory.path() / (chart.name + ".svg")).rdbuf();
    drawings[chart.name] = text.str();
  }
  return drawings;
}

}  // namespace

void write_report(const std::vector<RecordedRun>& runs, const fs::path& html) {
  const std::vector<ReportSection> sections = report_sections(runs);
  const std::string page = report_page(runs, sections, drawings_of(drawn_charts(sections)));
  const fs::path partial = html.string() + ".partial";
  std::ofstream file(partial);
  file << page;
  file.close();
  std::error_code error;
  if (file) fs::rename(partial, html, error);
  if (!file || error) {
    const int cause = errno;
    std::error_code ignored;
    fs::remove(partial, ignored);
    throw diagnostics::Failure(
        diagnostics::ExitCode::bad_usage,
        fmt::format("{}: cannot be written: {}; name another place with -o", html.string(),
                    error ? error.message() : std::strerror(cause)));
  }
}

}  // namespace tachless::report
