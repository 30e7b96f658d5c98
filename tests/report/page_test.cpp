// What moves in a report, in a real browser: cursor, robot, zoom, curves, theme; and how fast.

#include "robot/kinematics.h"
#include "tests/report/browser.h"

namespace tachless::report {
namespace {

/// The first number after `name` in `text`.
double number_after(const std::string& text, const std::string& name) {
  const std::size_t at = text.find(name + " ");
  return at == std::string::npos ? NAN : std::strtod(text.c_str() + at + name.size(), nullptr);
}

TEST_F(Browser, MovesTheRobotWithTheCursor) {
  const auto scenario = support::shortened("practical_rigid.yaml", "1");
  std::vector<RecordedRun> runs;
  runs.push_back(recorded("one", scenario));
  const fs::path page = profile_.path() / "report.html";
  write_report(runs, page);
  const Browsed browsed = tried(page, R"(
  const link = report_robot.robots[0].bodies[0], tool = report_robot.robots[0].tools[0];
  const charts = report.data.charts;
  const before = link.matrixWorld.elements.join();
  // The mouse, a third of the way into the second chart.
  find('#tracking-1').scrollIntoView();
  report.seek(0);
  const plot = charts[1].plot, area = plot.getArea(), box = charts[1].place.getBoundingClientRect();
  charts[1].place.dispatchEvent(new page.MouseEvent('mousemove',
      {bubbles: true, clientX: box.left + area.x + area.w / 3, clientY: box.top + 50}));
  say('time ' + report.state.t);
  say('moved ' + (before !== link.matrixWorld.elements.join()));
  say('together ' + (charts[0].line.style.transform === charts[1].line.style.transform));
  report.seek(0.05);
  tool.updateWorldMatrix(true);
  say('x ' + tool.matrixWorld.elements[12] + '; y ' + tool.matrixWorld.elements[13] + '; z ' + tool.matrixWorld.elements[14]);
  say('shown ' + find('#tracking-1 .keys output').textContent);
  find('#tracking-1 .keys button').click();
  say('visible ' + charts[0].plot.visibility());
  // Dragged from a fifth of the chart's width to two fifths; with Shift a tenth back; double-click.
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
  say('panned ' + drag(0.5, 0, true));
  charts[1].place.querySelector('canvas:last-of-type').dispatchEvent(new page.MouseEvent('dblclick', {bubbles: true}));
  say('all ' + charts[0].plot.xAxisRange().map(x => x.toFixed(2)));
  const theme = page.document.documentElement.dataset.theme;
  find('.theme').click();
  say('themes ' + theme + ' ' + page.document.documentElement.dataset.theme);
  say('fetched ' + page.performance.getEntriesByType('resource').length);
  find('.play').click();
  setTimeout(() => say('played ' + report.state.t + '; charts ' + charts.filter(chart => chart.plot).length), 3000);
)");
  SCOPED_TRACE(browsed.dom);
  EXPECT_EQ(browsed.console, "");
  EXPECT_NEAR(number_after(browsed.dom, "time"), 1.0 / 3, 0.01) << "a pixel is 2 ms";
  EXPECT_THAT(browsed.dom, HasSubstr("moved true; together true"));
  // Tick 50 is in the page as a 32-bit float: the robot is where our kinematics have it.
  const robot::Model& model = *scenario.model;
  const auto ticks = runs[0].tracking.joints()[0].q.points();
  ASSERT_EQ(ticks[50].x, 0.05);
  const robot::Vector q =
      (robot::Vector(2) << ticks[50].y, runs[0].tracking.joints()[1].q.points()[50].y).finished();
  const Eigen::Vector3d tool =
      robot::frame_pose<double>(model, robot::farthest_leaves(model).front(), q).p;
  EXPECT_GT(q.norm(), 0.01) << "no posture that says little";
  EXPECT_NEAR(number_after(browsed.dom, "x"), tool.x(), 1e-6);
  EXPECT_NEAR(number_after(browsed.dom, "y"), tool.y(), 1e-6);
  EXPECT_NEAR(number_after(browsed.dom, "z"), tool.z(), 1e-6);
  EXPECT_NEAR(number_after(browsed.dom, "shown"), q[0], 1e-3 * std::abs(q[0])) << "four digits";
  EXPECT_THAT(browsed.dom, HasSubstr("visible false,true; zoomed 0.20,0.40; panned 0.30,0.50; "
                                     "all 0.00,1.00; themes light dark; fetched 0; "));
  EXPECT_GT(number_after(browsed.dom, "played"), 0.05) << "it began at 0.05";
  EXPECT_EQ(number_after(browsed.dom, "charts"), 9);
}

TEST_F(Browser, SaysSoWithoutWebGlAndShowsTheChartsAllTheSame) {
  std::vector<RecordedRun> runs;
  runs.push_back(recorded("one", support::shortened("practical_rigid.yaml", "0.1")));
  const fs::path page = profile_.path() / "report.html";
  write_report(runs, page);
  const Browsed browsed =
      tried(page,
            "const wait = () => { if (!report.data.charts.every(chart => chart.plot)) return "
            "setTimeout(wait, 20); say(find('#robot').textContent); report.seek(0.05); "
            "say('charts ' + page.document.querySelectorAll('.plot canvas').length); }; wait();",
            10'000, {"--disable-3d-apis"});
  EXPECT_EQ(browsed.console, "");
  EXPECT_THAT(browsed.dom, HasSubstr("no WebGL: the robot cannot be shown.; charts 18"));
}

TEST_F(Browser, ShowsRobotsOfDifferentSizeSideBySide) {
  std::vector<RecordedRun> runs;
  runs.push_back(recorded("two", support::shortened("practical_rigid.yaml", "0.2")));
  runs.push_back(recorded("seven", support::shortened("iiwa_point_to_point.yaml", "0.4")));
  label(runs);
  const fs::path page = profile_.path() / "report.html";
  write_report(runs, page);
  const Browsed browsed = tried(page, R"(
  report.seek(0.3);
  const [two, seven] = report_robot.robots;
  say('bodies ' + [two.bodies.length, seven.bodies.length]);
  say('apart ' + (seven.ground.position.x - two.ground.position.x > two.reach));
  say('told ' + find('#facts .alarm').textContent);
)");
  EXPECT_EQ(browsed.console, "");
  EXPECT_THAT(browsed.dom, HasSubstr("bodies 4,7; apart true; told The robots have other joints"));
  EXPECT_THAT(browsed.dom, HasSubstr("practical_rigid has 2, iiwa_point_to_point has 7"));
}

TEST_F(Browser, IsNotUpsetByWildNumbers) {
  auto messages = support::in_process_log(support::shortened("practical_rigid.yaml", "0.5"));
  int truths = 0;
  for (logger::Recorded& message : messages) {
    if (message.channel != "ARM_TRUTH") continue;
    // The first joint's position, after fingerprint, stamps and counts: about 1e301, and infinity.
    if (truths == 100) message.data.replace(40, 2, "\x7e\x77");
    if (truths == 200) message.data.replace(40, 8, std::string("\x7f\xf0\0\0\0\0\0\0", 8));
    ++truths;
  }
  ASSERT_EQ(truths, 500);
  const fs::path log = profile_.path() / "lcmlog", page = profile_.path() / "report.html";
  logger::write_file(log, logger::log_of(messages));
  std::vector<RecordedRun> runs;
  runs.push_back(read_recorded_run(log));
  ASSERT_GT(runs[0].tracking.joints()[0].error.peak(), 1e300) << "not what was to be wild";
  write_report(runs, page);
  const Browsed browsed = tried(page, R"(
  for (let k = 0; k <= 500; ++k) report.seek(k / 1000);
  const all = report.data.charts;
  const wait = () => all.every(chart => chart.plot) ? say('charts ' + all.length + ', robot ' + report_robot.drawn) : setTimeout(wait, 20);
  wait();
)");
  EXPECT_EQ(browsed.console, "");
  EXPECT_THAT(browsed.dom, HasSubstr("charts 10, robot true"));
}

TEST_F(Browser, OpensAMinuteOfSevenJointsAtOnceAndFollowsTheCursor) {
  std::vector<RecordedRun> runs;
  runs.push_back(recorded("iiwa", support::shortened("iiwa_point_to_point.yaml", "60")));
  const fs::path page = profile_.path() / "report.html";
  write_report(runs, page);
  EXPECT_LT(fs::file_size(page), 5'000'000U) << "what a mail takes";
  // By the wall clock, on a machine without a GPU: the best of three openings, the median of the
  // frames. Each frame is waited for until it is drawn. docs/report.md has what a quiet machine
  // shows (0.6 s, 9 ms; 1 s and 16 ms are promised). The limits are three times the promise, for a
  // shared machine; what they refuse is work for every tick of the run at each opening or frame.
  double opened_ms = INFINITY, frame_ms = INFINITY;
  for (int i = 0; i < 3; ++i) {
    const Browsed browsed = tried(page, R"(
  const gl = find('#robot canvas').getContext('webgl'), pixel = new page.Uint8Array(4);
  find('#tracking-1').scrollIntoView();
  report.seek(0);
  const times = [...Array(101).keys()].map(i => {
    const before = page.performance.now();
    report.seek(60 * i / 100);
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
    return page.performance.now() - before;
  }).sort((a, b) => a - b);
  say('opened ' + page.document.documentElement.dataset.ready + '; frame ' + times[50]);
)",
                                  0);
    EXPECT_EQ(browsed.console, "");
    opened_ms = std::min(opened_ms, number_after(browsed.dom, "opened"));
    frame_ms = std::min(frame_ms, number_after(browsed.dom, "frame"));
  }
  RecordProperty("opened_ms", fmt::format("{}", opened_ms));
  RecordProperty("frame_ms", fmt::format("{}", frame_ms));
  EXPECT_LT(opened_ms, 3 * 1000);
  EXPECT_LT(frame_ms, 3 * 16);
}

}  // namespace
}  // namespace tachless::report
