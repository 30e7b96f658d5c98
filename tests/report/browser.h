#pragma once

// A report in a real browser, Chromium without a window. Screenshots and prints stay in the build
// directory's artefacts/report.

#include <fcntl.h>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmath>
#include <cstdlib>
#include <fstream>
#include <regex>
#include <set>

#include "report/report.h"
#include "tests/support/damaged_log.h"
#include "tests/support/in_process_log.h"
#include "tests/support/temporary_directory.h"

namespace tachless::report {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using ::testing::Not;

inline const fs::path artefacts = fs::path(TACHLESS_BINARY_DIR) / "artefacts" / "report";

struct Browsed {
  std::string dom;      // of --dump-dom
  std::string console;  // lines that the page wrote there
};

class Browser : public ::testing::Test {
 protected:
  /// Opens `page` without a window; waits for it at most 60 s.
  Browsed open(const fs::path& page, const std::vector<std::string>& options) {
    const fs::path out = profile_.path() / "out", err = profile_.path() / "err";
    const fs::path profile = profile_.path() / ("profile-" + std::to_string(++opened_));
    std::vector<std::string> words = {"chromium",
                                      "--headless",
                                      "--no-sandbox",
                                      "--disable-gpu",
                                      "--enable-unsafe-swiftshader",  // WebGL without a GPU
                                      "--disable-background-networking",
                                      "--disable-component-update",
                                      "--disable-sync",
                                      "--disable-dev-shm-usage",
                                      "--no-first-run",
                                      "--hide-scrollbars",
                                      "--allow-file-access-from-files",
                                      "--enable-logging=stderr",
                                      "--v=0",
                                      "--user-data-dir=" + profile.string()};
    words.insert(words.end(), options.begin(), options.end());
    words.push_back("file://" + page.string());
    std::vector<char*> argv;
    for (std::string& word : words) argv.push_back(word.data());
    argv.push_back(nullptr);
    const pid_t pid = fork();
    if (pid == 0) {
      setpgid(0, 0);
      alarm(60);
      dup2(::open(out.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0644), STDOUT_FILENO);
      dup2(::open(err.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0644), STDERR_FILENO);
      execvp(argv[0], argv.data());
      _exit(127);
    }
    int status = 0;
    waitpid(pid, &status, 0);
    kill(-pid, SIGKILL);
    EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0)
        << "chromium: status " << status << "\n"
        << logger::read_file(err);
    Browsed browsed;
    browsed.dom = logger::read_file(out);
    std::ifstream lines(err);
    for (std::string line; std::getline(lines, line);) {
      // On a host without a network the browser itself remarks on that; the page has said nothing.
      // Nor does it when the browser reads back what it has drawn, for a screenshot.
      const bool remark = line.find("Slow network is detected") != std::string::npos ||
                          line.find("GL Driver Message") != std::string::npos;
      if (line.find("CONSOLE") != std::string::npos && !remark) browsed.console += line + "\n";
    }
    return browsed;
  }

  /// What a script in a frame of `width` finds out about `page`.
  Browsed measured(const fs::path& page, int width) {
    const fs::path frame = page.parent_path() / ("frame-" + std::to_string(width) + ".html");
    std::ofstream(frame) << R"(<!DOCTYPE html><title>frame</title><style>body{margin:0}</style>
<iframe style="border:0;width:)"
                         << width << R"(px;height:900px" src=")" << page.filename().string()
                         << R"("></iframe><pre></pre><script>
const frame = document.querySelector('iframe');
frame.onload = () => setTimeout(() => {
  const page = frame.contentDocument;
  const figures = [...page.querySelectorAll('figure')];
  // A chart that moves, or a drawing that does not.
  const seen = figures.filter(figure => [...figure.querySelectorAll('svg, .plot')].filter(drawn => {
    const box = drawn.getBoundingClientRect();
    return box.width > 250 && box.height > 60 && drawn.querySelectorAll('path, canvas').length > 1;
  }).length === 1);
  document.querySelector('pre').textContent = 'figures ' + figures.length + ', seen ' +
      seen.length + ', overflow ' +
      (page.documentElement.scrollWidth - page.documentElement.clientWidth) + ', height ' +
      page.documentElement.scrollHeight + '.';
}, 3000);
</script>)";
    return open(frame, {"--dump-dom", "--virtual-time-budget=10000", "--window-size=1400,1000"});
  }

  /// What `script` (JavaScript, page: the window of the report, say: a function) says of `page`
  /// when it has been opened 900 px high. By the wall clock without a budget of virtual time [ms].
  Browsed tried(const fs::path& page, const std::string& script, int virtual_ms = 10'000,
                std::vector<std::string> options = {}) {
    const fs::path frame = page.parent_path() / "tried.html";
    std::ofstream(frame) << R"(<!DOCTYPE html><title>frame</title><style>body{margin:0}</style>
<iframe style="border:0;width:1280px;height:900px" src=")"
                         << page.filename().string() << R"("></iframe><pre></pre><script>
const say = text => document.querySelector('pre').textContent += text + '; ';
document.querySelector('iframe').onload = (event) => {
  const page = event.target.contentWindow, find = text => page.document.querySelector(text);
  const {report, report_robot} = page;
)" << script << "};\n</script>";
    options.push_back("--dump-dom");
    if (virtual_ms > 0) options.push_back(fmt::format("--virtual-time-budget={}", virtual_ms));
    Browsed browsed = open(frame, options);
    fs::remove(frame);
    const std::size_t begin = browsed.dom.find("<pre>"), end = browsed.dom.find("</pre>");
    browsed.dom = browsed.dom.substr(begin + 5, end - begin - 5);
    return browsed;
  }

  void look_at(const std::string& name, const std::vector<RecordedRun>& runs, int num_figures) {
    fs::create_directories(artefacts);
    const fs::path page = artefacts / (name + ".html");
    write_report(runs, page);
    for (const auto& [device, width] : {std::pair{"desktop", 1280}, std::pair{"phone", 390}}) {
      SCOPED_TRACE(device);
      const Browsed browsed = measured(page, width);
      EXPECT_EQ(browsed.console, "");
      const std::string expected = "figures " + std::to_string(num_figures) + ", seen " +
                                   std::to_string(num_figures) + ", overflow 0, height ";
      EXPECT_THAT(browsed.dom, HasSubstr(expected));
      static const std::regex height("height ([0-9]+)\\.");
      std::smatch match;
      ASSERT_TRUE(std::regex_search(browsed.dom, match, height));

      const fs::path picture = artefacts / (name + "-" + device + ".png");
      fs::remove(picture);
      // The browser refuses windows as narrow as a phone; a frame in it is not a window.
      const fs::path frame = artefacts / "frame.html";
      std::ofstream(frame) << "<!DOCTYPE html><title>frame</title><style>body{margin:0}</style>"
                           << "<iframe style=\"border:0;width:" << width << "px;height:" << match[1]
                           << "px\" src=\"" << page.filename().string() << "\"></iframe>";
      const Browsed shown = open(frame, {"--screenshot=" + picture.string(),
                                         "--window-size=" + std::to_string(std::max(width, 500)) +
                                             "," + std::string(match[1])});
      EXPECT_EQ(shown.console, "");
      EXPECT_GT(fs::file_size(picture), 50'000U) << "an empty picture is far smaller";
      fs::remove(frame);
      fs::remove(artefacts / ("frame-" + std::to_string(width) + ".html"));
    }
  }

  /// A word on paper, in points from the upper left corner.
  struct Word {
    double left, top, right, bottom;
    std::string text;
  };

  /// The words of each page of a print.
  std::vector<std::vector<Word>> words_of(const fs::path& pdf) {
    const fs::path boxes = profile_.path() / "boxes.html";
    const std::string command = "pdftotext -bbox '" + pdf.string() + "' '" + boxes.string() + "'";
    EXPECT_EQ(std::system(command.c_str()), 0);
    static const std::regex word(
        "<word xMin=\"([^\"]+)\" yMin=\"([^\"]+)\" xMax=\"([^\"]+)\" "
        "yMax=\"([^\"]+)\">([^<]*)</word>");
    std::vector<std::vector<Word>> pages;
    std::ifstream lines(boxes);
    for (std::string line; std::getline(lines, line);) {
      std::smatch match;
      if (line.find("<page") != std::string::npos) {
        EXPECT_THAT(line, HasSubstr("width=\"594.9")) << "not A4";
        pages.emplace_back();
      } else if (std::regex_search(line, match, word)) {
        pages.back().push_back({std::stod(match[1]), std::stod(match[2]), std::stod(match[3]),
                                std::stod(match[4]), match[5]});
      }
    }
    return pages;
  }

  /// Prints a page, A4.
  void print(const std::string& name, int num_charts, std::size_t most_pages) {
    const fs::path pdf = artefacts / (name + ".pdf");
    fs::remove(pdf);
    open(artefacts / (name + ".html"),
         {"--no-pdf-header-footer", "--print-to-pdf=" + pdf.string()});
    const auto pages = words_of(pdf);
    EXPECT_GE(pages.size(), 3U);
    EXPECT_LE(pages.size(), most_pages);
    constexpr double width = 595, height = 842, side = 39, edge = 42;  // margins of 14 and 15 mm
    const std::set<std::string> headings = {"Tracking",   "Position", "Torque",
                                            "Controller", "Lyapunov", "Timing"};
    int time_axes = 0;
    std::set<std::string> seen;
    for (std::size_t i = 0; i < pages.size(); ++i) {
      SCOPED_TRACE("page " + std::to_string(i + 1));
      EXPECT_FALSE(pages[i].empty());
      double last_axis = 0;
      for (const Word& word : pages[i]) {
        EXPECT_GE(word.left, side) << word.text;
        EXPECT_LE(word.right, width - side) << word.text;
        EXPECT_GE(word.top, edge) << word.text;
        EXPECT_LE(word.bottom, height - edge) << word.text;
        const bool is_small = word.bottom - word.top < 9;  // as only charts write
        if (is_small && (word.text == "[s]" || word.text == "[µs]")) {
          ++time_axes;
          last_axis = std::max(last_axis, word.bottom);
        }
      }
      for (const Word& word : pages[i]) {
        if (word.bottom - word.top < 15 || !headings.contains(word.text)) continue;
        seen.insert(word.text);
        EXPECT_GT(last_axis, word.bottom) << word.text << " heads nothing on its page";
      }
    }
    EXPECT_EQ(time_axes, num_charts) << "the axis below each chart";
    EXPECT_EQ(seen, headings);
  }

  RecordedRun recorded(const std::string& name, const experiment::Scenario& scenario) {
    const fs::path log = profile_.path() / name / "lcmlog";
    fs::create_directories(log.parent_path());
    logger::write_file(log, logger::log_of(support::in_process_log(scenario)));
    std::ofstream(log.parent_path() / "summary.json") << R"({"run_id": 7, "wall_s": 0.25,
      "real_time_factor": 2, "fault": null, "round_trip_us": {"p50": 30, "p99": 60, "p999": 90,
      "max": 100, "histogram": [[30, 400], [34, 99], [38, 50], [60, 3], [90, 1]]}})";
    return read_recorded_run(log);
  }

  TemporaryDirectory profile_;
  int opened_ = 0;
};

}  // namespace tachless::report
