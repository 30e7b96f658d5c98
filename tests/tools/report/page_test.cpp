// The report in a real browser, Chromium without a window. Charts and robot are drawn and follow
// one cursor. No text of a log acts as markup or script, and the console stays empty. A picture is
// saved in the build directory's artefacts/report.

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <vector>

#include "report/report.h"
#include "robot/kinematics.h"
#include "tests/support/damaged_log.h"
#include "tests/support/in_process_log.h"
#include "tests/support/temporary_directory.h"

namespace tachless::report {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;

struct Browsed {
  std::string output;   ///< output of the script
  std::string console;  ///< console lines of the page
};

class Page : public ::testing::Test {
 protected:
  /// Returns what `script` prints about the page, in a frame of that width. In the JavaScript, page
  /// is the report's window and say() prints.
  Browsed tried(const fs::path& page, const std::string& script, int width = 1280) {
    const fs::path frame = page.parent_path() / "tried.html";
    std::ofstream(frame) << R"(<!DOCTYPE html><title>frame</title><style>body{margin:0}</style>
<iframe style="border:0;width:)"
                         << width << R"(px;height:900px" src=")" << page.filename().string()
                         << R"("></iframe><pre></pre><script>
const say = text => document.querySelector('pre').textContent += text + '; ';
document.querySelector('iframe').onload = (event) => {
  const page = event.target.contentWindow, find = text => page.document.querySelector(text);
  const {report, report_robot} = page;
  const wait = () => report && !report.data.charts.every(chart => chart.plot) ? setTimeout(wait, 20) : (() => {
)" << script << "})(); wait();};\n</script>";
    const std::string dom = chromium(
        {"--dump-dom", "--virtual-time-budget=10000", "--allow-file-access-from-files"}, frame);
    const std::size_t begin = dom.find("<pre>"), end = dom.find("</pre>");
    return {dom.substr(begin + 5, end - begin - 5), console_};
  }

  /// Runs Chromium and puts the page's console lines into `console_`.
  /// @return standard output
  std::string chromium(std::vector<std::string> options, const fs::path& page) {
    const fs::path out = directory_ / "out", err = directory_ / "err";
    std::string command =
        "timeout -s KILL 120 chromium --headless --no-sandbox --disable-gpu "
        "--enable-unsafe-swiftshader --disable-background-networking "
        "--disable-component-update --disable-sync --disable-dev-shm-usage "
        "--no-first-run --hide-scrollbars --enable-logging=stderr --v=0";
    options.push_back("--user-data-dir=" + (directory_ / "profile").string());
    options.push_back("file://" + page.string());
    for (const std::string& option : options) command += " '" + option + "'";
    EXPECT_EQ(std::system((command + " > " + out.string() + " 2> " + err.string()).c_str()), 0)
        << logger::read_file(err);
    console_.clear();
    std::ifstream lines(err);
    for (std::string line; std::getline(lines, line);) {
      // The browser itself reports a host without a network or a GPU. dygraphs 2.2 reports the
      // points beyond an axis.
      const bool remark = line.find("Slow network is detected") != std::string::npos ||
                          line.find("GL Driver Message") != std::string::npos ||
                          line.find(" points out of ") != std::string::npos;
      if (line.find("CONSOLE") != std::string::npos && !remark) console_ += line + "\n";
    }
    return logger::read_file(out);
  }

  RecordedRun recorded(const std::string& name, const scenario::Scenario& scenario) {
    const fs::path log = directory_.path() / name / "lcmlog";
    fs::create_directories(log.parent_path());
    logger::write_file(log, logger::log_of(support::in_process_log(scenario)));
    std::ofstream(log.parent_path() / "summary.json") << R"({"run_id": 7, "wall_s": 0.25,
      "real_time_factor": 2, "fault": null, "round_trip_us": {"p50": 30, "p99": 60, "p999": 90,
      "max": 100, "histogram": [[30, 400], [34, 99], [38, 50], [60, 3], [90, 1]]}})";
    return read_recorded_run(log);
  }

  TemporaryDirectory directory_;
  std::string console_;
};

/// Returns the number after `name` in `text`.
double number_after(const std::string& text, const std::string& name) {
  const std::size_t at = text.find(name + " ");
  return at == std::string::npos ? NAN : std::strtod(text.c_str() + at + name.size(), nullptr);
}

// A chart has a canvas with a coloured point in it, and a drawing has a path. Nothing is wider than
// the page.
constexpr const char* look = R"(
  const figures = [...page.document.querySelectorAll('figure[id]')];
  const painted = canvas => canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height)
      .data.some((value, i) => i % 4 === 3 && value > 0);
  const seen = figures.filter(figure => {
    const box = figure.getBoundingClientRect();
    const canvases = [...figure.querySelectorAll('canvas')];
    return box.width > 250 && box.height > 60 &&
        (figure.querySelector('svg path') || canvases.some(painted));
  });
  const root = page.document.documentElement;
  say('figures ' + figures.length + ', seen ' + seen.length + ', robot ' + report_robot.drawn +
      ', overflow ' + (root.scrollWidth - root.clientWidth));
)";

TEST_F(Page, DrawsChartsAndRobotOnDesktopAndPhone) {
  std::vector<RecordedRun> runs;
  runs.push_back(recorded("one", support::shortened("practical_rigid.yaml", "1",
                                                    {"plant.drive.torque_limit_Nm=[500, 60]"})));
  const fs::path page = directory_.path() / "report.html";
  write_report(runs, page);
  for (const int width : {1280, 390}) {
    const Browsed browsed = tried(page, look, width);
    EXPECT_EQ(browsed.console, "");
    // The charts: two joints' tracking, error, torque, controller signals; V; round trip;
    // saturation.
    EXPECT_EQ(browsed.output, "figures 11, seen 11, robot true, overflow 0; ") << width;
  }
  const fs::path artefacts = fs::path(TACHLESS_BINARY_DIR) / "artefacts" / "report";
  fs::create_directories(artefacts);
  fs::remove(artefacts / "report.png");
  chromium({"--screenshot=" + (artefacts / "report.png").string(), "--window-size=1280,2400",
            "--virtual-time-budget=10000"},
           page);
  EXPECT_GT(fs::file_size(artefacts / "report.png"), 50'000U) << "an empty picture is far smaller";
}

TEST_F(Page, MovesTheRobotWithTheCursor) {
  const auto scenario = support::shortened("practical_rigid.yaml", "1");
  std::vector<RecordedRun> runs;
  runs.push_back(recorded("one", scenario));
  const fs::path page = directory_.path() / "report.html";
  write_report(runs, page);
  const Browsed browsed = tried(page, R"(
  const tool = report_robot.robots[0].tools[0], charts = report.data.charts;
  // The mouse, a third of the way into the second chart.
  find('#tracking-1').scrollIntoView();
  report.seek(0);
  const plot = charts[1].plot, area = plot.getArea(), box = charts[1].place.getBoundingClientRect();
  charts[1].place.dispatchEvent(new page.MouseEvent('mousemove',
      {bubbles: true, clientX: box.left + area.x + area.w / 3, clientY: box.top + 50}));
  say('time ' + report.state.t);
  say('together ' + (charts[0].line.style.transform === charts[1].line.style.transform));
  report.seek(0.05);
  tool.updateWorldMatrix(true);
  say('x ' + tool.matrixWorld.elements[12] + '; y ' + tool.matrixWorld.elements[13] + '; z ' + tool.matrixWorld.elements[14]);
  find('#tracking-1 .keys button').click();
  say('visible ' + charts[0].plot.visibility());
  const drag = (from, to, shiftKey) => {
    const at = (type, part, buttons) => new page.MouseEvent(type, {bubbles: true, view: page, buttons, shiftKey,
        clientX: box.left + area.x + part * area.w, clientY: box.top + 50,
        screenX: box.left + area.x + part * area.w, screenY: box.top + 50});
    charts[1].place.querySelector('canvas:last-of-type').dispatchEvent(at('mousedown', from, 1));
    page.document.dispatchEvent(at('mousemove', to, 1));
    page.document.dispatchEvent(at('mouseup', to, 0));
    return charts[0].plot.xAxisRange().map(x => x.toFixed(2));
  };
  say('zoomed ' + drag(0.2, 0.4, false));
  find('.theme').click();
  say('theme ' + page.document.documentElement.dataset.theme);
  say('fetched ' + page.performance.getEntriesByType('resource').length);
)");
  SCOPED_TRACE(browsed.output);
  EXPECT_EQ(browsed.console, "");
  EXPECT_NEAR(number_after(browsed.output, "time"), 1.0 / 3, 0.01) << "a pixel is 2 ms";
  // Tick 50 is in the page as a 32-bit float. The robot is where this program's kinematics put it.
  const auto ticks = runs[0].tracking.joints()[0].q.points();
  ASSERT_EQ(ticks[50].x, 0.05);
  const Vector q =
      (Vector(2) << ticks[50].y, runs[0].tracking.joints()[1].q.points()[50].y).finished();
  const Eigen::Vector3d tool =
      robot::frame_pose(*scenario.model, robot::farthest_leaves(*scenario.model).front(), q).p;
  EXPECT_GT(q.norm(), 0.01) << "no posture that shows little";
  EXPECT_NEAR(number_after(browsed.output, "x"), tool.x(), 1e-6);
  EXPECT_NEAR(number_after(browsed.output, "y"), tool.y(), 1e-6);
  EXPECT_NEAR(number_after(browsed.output, "z"), tool.z(), 1e-6);
  EXPECT_THAT(browsed.output, AllOf(HasSubstr("together true"), HasSubstr("visible false,true"),
                                    HasSubstr("zoomed 0.20,0.40; theme dark; fetched 0; ")));
}

TEST_F(Page, ShowsWildNumbersAndRobotsSideBySide) {
  auto messages = support::in_process_log(support::shortened("practical_rigid.yaml", "0.5"));
  int truths = 0;
  for (logger::Recorded& message : messages) {
    if (message.channel != "ARM_TRUTH") continue;
    // The first joint's position follows fingerprint, stamps and counts. It becomes about 1e301,
    // then infinity.
    if (truths == 100) message.data.replace(40, 2, "\x7e\x77");
    if (truths == 200) message.data.replace(40, 8, std::string("\x7f\xf0\0\0\0\0\0\0", 8));
    ++truths;
  }
  const fs::path log = directory_.path() / "wild", page = directory_.path() / "report.html";
  logger::write_file(log, logger::log_of(messages));
  std::vector<RecordedRun> runs;
  runs.push_back(read_recorded_run(log));
  ASSERT_GT(runs[0].tracking.joints()[0].error.peak(), 1e300) << "not what was to be wild";
  runs.push_back(recorded("seven", support::shortened("iiwa_point_to_point.yaml", "0.4")));
  label(runs);
  write_report(runs, page);
  const Browsed browsed = tried(page, R"(
  for (let k = 0; k <= 100; ++k) report.seek(k / 200);
  const [two, seven] = report_robot.robots;
  say('bodies ' + [two.bodies.length, seven.bodies.length]);
  say('apart ' + (seven.ground.position.x - two.ground.position.x > two.reach));
  say('alarm ' + find('#facts .alarm').textContent);
)");
  EXPECT_EQ(browsed.console, "");
  EXPECT_THAT(browsed.output,
              HasSubstr("bodies 4,7; apart true; alarm The robots have other joints"));
}

/// The corners of a box about the origin, and the two triangles of each side.
std::vector<Eigen::Vector3f> corners(float x, float y, float z) {
  std::vector<Eigen::Vector3f> all;
  for (int k = 0; k < 8; ++k) {
    all.emplace_back((k & 4) != 0 ? x / 2 : -x / 2, (k & 2) != 0 ? y / 2 : -y / 2,
                     (k & 1) != 0 ? z / 2 : -z / 2);
  }
  return all;
}
constexpr std::array<std::array<int, 3>, 12> triangles = {{{0, 1, 3},
                                                           {0, 3, 2},
                                                           {4, 6, 7},
                                                           {4, 7, 5},
                                                           {0, 4, 5},
                                                           {0, 5, 1},
                                                           {2, 3, 7},
                                                           {2, 7, 6},
                                                           {0, 2, 6},
                                                           {0, 6, 4},
                                                           {1, 5, 7},
                                                           {1, 7, 3}}};

/// Writes boxes as binary STL without normals, as OBJ, and as Collada in centimetres.
void write_meshes(const fs::path& folder) {
  std::string stl(84, '\0'), obj, points, sides;
  stl[80] = 12;
  const std::vector<Eigen::Vector3f> of_stl = corners(100, 100, 1000);
  for (const auto& triangle : triangles) {
    stl += std::string(12, '\0');
    for (const int k : triangle) {
      stl.append(reinterpret_cast<const char*>(of_stl[static_cast<std::size_t>(k)].data()), 12);
    }
    stl += std::string(2, '\0');
    sides += fmt::format("{} ", fmt::join(triangle, " "));
  }
  for (const auto& p : corners(.2F, .2F, .2F)) obj += fmt::format("v {} {} {}\n", p[0], p[1], p[2]);
  for (const auto& [a, b, c] : triangles) obj += fmt::format("f {} {} {}\n", a + 1, b + 1, c + 1);
  for (const auto& p : corners(10, 60, 10)) points += fmt::format("{} {} {} ", p[0], p[1], p[2]);
  fs::create_directories(folder / "arm" / "meshes");
  std::ofstream(folder / "long.STL") << stl;
  std::ofstream(folder / "cube.obj") << obj;
  std::ofstream(folder / "arm" / "meshes" / "flat.dae")
      << R"(<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit meter="0.01"/><up_axis>Z_UP</up_axis></asset>
<library_geometries><geometry id="g"><mesh><source id="p"><float_array id="a" count="24">)"
      << points << R"(</float_array><technique_common><accessor source="#a" count="8" stride="3">
<param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/>
</accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="12"><input semantic="VERTEX" source="#v" offset="0"/><p>)"
      << sides << R"(</p></triangles></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node id="n"><instance_geometry url="#g"/></node>
</visual_scene></library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>)";
}

TEST_F(Page, ShowsTheVisualsOfTheUrdf) {
  const auto scenario = support::shortened("practical_rigid.yaml", "0.1");
  std::string urdf = logger::read_file(TACHLESS_SOURCE_DIR "/scenarios/robots/two_link.urdf");
  const auto put = [&](const std::string& shape, const std::string& mesh) {
    const std::size_t at = urdf.find(shape);
    ASSERT_NE(at, urdf.npos) << shape;
    urdf.replace(at, shape.size(), "<mesh filename=\"" + mesh + "\"/>");
  };
  put(R"(<cylinder radius="0.05" length="1"/>)", R"(long.STL" scale="0.001 0.001 0.001)");
  put(R"(<sphere radius="0.05"/>)", "cube.obj");
  put(R"(<cylinder radius="0.11" length="0.03"/>)", "package://arm/meshes/flat.dae");
  put(R"(<cylinder radius="0.15" length="0.06"/>)", "not_there.stl");
  const fs::path folder = directory_.path() / "urdf", page = directory_.path() / "report.html";
  write_meshes(folder);
  std::vector<RecordedRun> runs;
  runs.push_back(recorded("one", scenario));
  runs[0].visuals = read_visuals(urdf, folder);
  EXPECT_EQ(runs[0].visuals.meshes.size(), 3U);
  write_report(runs, page);
  const Browsed browsed = tried(page, R"(
  const {THREE} = page, of = mesh => mesh.body ? mesh : of(mesh.parent);
  report_robot.robots[0].bodies.forEach((group, k) => group.traverse(mesh => {
    if (!mesh.isMesh || of(mesh) !== group) return;
    mesh.geometry.computeBoundingBox();
    const inside = new THREE.Matrix4().getInverse(group.matrixWorld).multiply(mesh.matrixWorld);
    const {min, max} = mesh.geometry.boundingBox.clone().applyMatrix4(inside);
    say(k + ': ' + [...min.toArray(), ...max.toArray()].map(x => x.toFixed(2)).join(' ') + ' #' + mesh.material.color.getHexString());
  }));
)");
  EXPECT_THAT(browsed.console, HasSubstr("not_there.stl is not drawn"));
  // The colour 0.65 is 165.75, and three.js truncates it. The bodies are link1; link2 and its tip;
  // the rotor's cylinder of the mechanics; the belt disc.
  EXPECT_THAT(browsed.output, HasSubstr("0: -0.05 -0.05 -1.00 0.05 0.05 0.00 #2659a5; 1: "));
  EXPECT_THAT(browsed.output, HasSubstr("1: -0.10 -0.10 -1.10 0.10 0.10 -0.90 #"));
  EXPECT_THAT(browsed.output, HasSubstr("3: -0.05 -0.15 -0.35 0.05 -0.05 0.25 #"));
}

// This covers every text of a run that reaches the page.
TEST_F(Page, RunsNothingThatALogSays) {
  const std::string evil =
      "</script><script>window.hit=1</script><img src=x onerror=window.hit=1>"
      "'\"]]>\\\n!touch canary\n`touch canary`$(touch canary)";
  std::vector<RecordedRun> runs;
  runs.push_back(recorded("one", support::shortened("practical_rigid.yaml", "0.1")));
  RecordedRun& run = runs[0];
  run.label = run.scenario.name = run.scenario.robot.name = run.info.version = evil;
  run.scenario.controller.law = run.info.measurement = run.info.scenario = run.info.robot = evil;
  for (std::string& name : run.joints.name) name = evil;
  for (LoggedSignal& signal : run.signals) signal.name = signal.unit = evil;
  for (auto& piece : run.summary.pieces) piece.channel = evil;
  run.summary.pieces[0].missing.count = 1;
  run.summary.faults.push_back({messages::Role::controller, 17, evil});
  run.lyapunov_formula = evil;
  run.outcome["fault"] = evil;
  run.log = directory_.path() / evil;
  const fs::path page = directory_.path() / "report.html";
  write_report(runs, page);
  EXPECT_THAT(logger::read_file(page), HasSubstr("&lt;script&gt;window.hit"));
  const Browsed browsed = tried(page, R"(
  for (const key of page.document.querySelectorAll('.keys button')) key.click();
  say('hit ' + page.hit + ', images ' + page.document.querySelectorAll('img').length +
      ', scripts ' + page.document.querySelectorAll('script').length + ', robot ' + report_robot.drawn);
)");
  EXPECT_EQ(browsed.console, "");
  EXPECT_EQ(browsed.output, "hit undefined, images 0, scripts 6, robot true; ");
  EXPECT_FALSE(fs::exists("canary"));
}

}  // namespace
}  // namespace tachless::report
