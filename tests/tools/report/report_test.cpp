#include "report/report.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <regex>
#include <set>
#include <span>
#include <string>

#include "base/failure.h"
#include "base/json_text.h"
#include "base/logging.h"
#include "lyapunov/stability_certificate.h"
#include "messages/wire.h"
#include "report/report_sections.h"
#include "tests/support/damaged_log.h"
#include "tests/support/in_process_log.h"
#include "tests/support/recorded_run.h"
#include "tests/support/temporary_directory.h"
#include "tests/tools/report/count.h"

namespace tachless::report {
namespace {

using logger::Recorded;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

class Report : public ::testing::Test {
 protected:
  std::filesystem::path write_log(const std::string& directory,
                                  const std::vector<Recorded>& messages) {
    const auto path = directory_.path() / directory / "lcmlog";
    std::filesystem::create_directories(path.parent_path());
    logger::write_file(path, logger::log_of(messages));
    return path;
  }
  RecordedRun run(const std::string& directory, const std::vector<Recorded>& messages) {
    return read_recorded_run(write_log(directory, messages));
  }
  /// Sets the gains of the ticks [from, to).
  static void set_gains(std::vector<Recorded>& messages, std::size_t from, std::size_t to) {
    messages::Codec<messages::ReferencePoint> codec(messages::layout(2, false));
    for (std::size_t tick = from; tick < to; ++tick) {
      std::string& data = messages[1 + 6 * tick + 2].data;
      messages::Stamp stamp;
      messages::ReferencePoint reference;
      ASSERT_EQ(codec.decode(std::as_bytes(std::span(data)), stamp, reference),
                messages::Rejection::none);
      reference.gains = "kp=300,100";
      const auto bytes = codec.encode(stamp, reference);
      data.assign(reinterpret_cast<const char*>(bytes.data()), bytes.size());
    }
  }
  static std::string page_of(std::vector<RecordedRun> runs) {
    label(runs);
    const Overlay all(runs);
    return report_page(all, report_sections(all));
  }

  TemporaryDirectory directory_;
};

TEST_F(Report, HasEveryPartAndRefersToNothingOutside) {
  const auto log =
      write_log("a", support::in_process_log(support::shortened("practical_rigid.yaml", "0.5")));
  std::ofstream(log.parent_path() / "summary.json") << R"({"run_id": 7, "wall_s": 0.25,
    "real_time_factor": 2, "fault": null, "round_trip_us": {"p50": 30, "p99": 60, "p999": 90,
    "max": 100, "histogram": [[30, 400], [34, 99], [90, 1]]},
    "command_age_us": {"histogram": [[20, 500]]},
    "wake_up_jitter_us": {"histogram": [[1, 300], [2, 200]]}})";
  std::vector<RecordedRun> runs;
  runs.push_back(read_recorded_run(log));
  const auto html = directory_.path() / "report.html";
  write_report(runs, html);
  const std::string page = logger::read_file(html);
  for (const std::string figure :
       {"tracking-1", "tracking-2", "error-1", "error-2", "torque-1", "torque-2", "controller-1",
        "controller-2", "lyapunov-v", "round-trip", "command-age", "wake-up"}) {
    EXPECT_THAT(page, HasSubstr("<figure id=\"" + figure + "\"")) << figure;
  }
  EXPECT_EQ(count(page, "<figure id"), 12U);
  EXPECT_EQ(count(page, "class=\"live"), 10U) << "those over time, and a paragraph about them";
  EXPECT_EQ(count(page, "<svg role=\"img\""), 4U) << "histograms, and what stands in for scripts";
  EXPECT_EQ(count(page, "<noscript><figure"), 1U);
  // The browser fetches nothing. Nothing outside the scripts would make it fetch either.
  EXPECT_THAT(page, HasSubstr("content=\"default-src 'none'; script-src 'unsafe-inline'; "
                              "style-src 'unsafe-inline'; img-src data:\""));
  const std::string still = page.substr(0, page.find("<script"));
  EXPECT_THAT(still, AllOf(HasSubstr("</footer>"), Not(HasSubstr("://")), Not(HasSubstr("@import")),
                           Not(HasSubstr("src="))));
  EXPECT_THAT(page, AllOf(HasSubstr("practical_rigid"), HasSubstr("loria_ortega_rigid"),
                          HasSubstr("kp: [40000, 2400]"), HasSubstr("resolution_bits: 20")))
      << "the scenario is on the page";
  EXPECT_THAT(page, HasSubstr("No torque saturated, no command was missed"));
  // Every id occurs once.
  static const std::regex id(" id=['\"]([^'\"]+)['\"]");
  std::set<std::string> ids;
  for (std::sregex_iterator match(page.begin(), page.end(), id), end; match != end; ++match) {
    EXPECT_TRUE(ids.insert((*match)[1]).second) << (*match)[1];
  }
}

/// The acting torques are 1.2 times the applied ones, and so are the model's.
TEST_F(Report, ShowsTheTorqueOfTheModelBesideThatApplied) {
  const auto run_with = [&](const std::string& name, const std::string& scale) {
    return run(name, support::in_process_log(
                         support::shortened("practical_rigid.yaml", "2.5",
                                            {"plant.drive.viscous_friction_Nms_per_rad=[2, 1]",
                                             "plant.drive.torque_scale=" + scale})));
  };
  const RecordedRun exact = run_with("a", "1"), more = run_with("b", "1.2");
  ASSERT_EQ(exact.model_torque.size(), 2U);
  const auto peak = [](const study::Envelope& of) {
    double largest = 0;
    for (const study::Point& each : of.points()) largest = std::max(largest, std::abs(each.y));
    return largest;
  };
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_LT(exact.model_torque[i].error, 0.01);
    EXPECT_GT(more.model_torque[i].error, 0.05);
    // The filter's effect on counts and on the start causes the difference.
    EXPECT_NEAR(peak(more.model_torque[i].model) / peak(more.model_torque[i].applied), 1.2, 0.02);
  }
  const std::string page = page_of({more});
  EXPECT_THAT(page, AllOf(HasSubstr("<figure id=\"model-2\""), HasSubstr("over the peak: ")));
}

TEST_F(Report, ShowsTheTrackingFigureWithoutALibraryAndNamesThePackages) {
  std::vector<RecordedRun> runs;
  runs.push_back(run("a", support::in_process_log(support::shortened("regulation.yaml", "0.01"))));
  std::filesystem::create_directories(directory_.path() / "dygraphs");
  std::ofstream(directory_.path() / "dygraphs" / "dygraph.min.js") << "'use strict';";
  const Libraries libraries = read_libraries(directory_.path());
  EXPECT_THAT(libraries.missing, HasSubstr("three/three.min.js"));
  const auto html = directory_.path() / "report.html";
  ::testing::internal::CaptureStderr();
  base::start_logging("test", base::Verbosity::normal);
  write_report(runs, html, libraries);
  EXPECT_THAT(::testing::internal::GetCapturedStderr(),
              HasSubstr("apt-get install libjs-dygraphs libjs-three"));
  const std::string page = logger::read_file(html);
  EXPECT_THAT(page, AllOf(HasSubstr("<figure class=\"wide\"><svg role=\"img\""),
                          Not(HasSubstr("<script")), Not(HasSubstr("<noscript"))));
  ::testing::internal::CaptureStderr();
  EXPECT_THAT(live_page(runs[0], {}, libraries), Not(HasSubstr("<script")));
  EXPECT_THAT(::testing::internal::GetCapturedStderr(),
              HasSubstr("the live page has no charts that move"));
}

TEST_F(Report, DrawsTheTorquesThatAnArmTold) {
  using messages::truth::Told;
  for (const auto told :
       {std::optional(Told::both), std::optional(Told::measured), std::optional<Told>()}) {
    std::vector<RecordedRun> runs;
    runs.push_back(run("told", logger::short_arm_run(told).messages));
    const std::size_t joints = 2;
    EXPECT_EQ(runs[0].accepted_torque.size(), told == Told::both ? joints : 0);
    EXPECT_EQ(runs[0].measured_torque.size(), told ? joints : 0);
    if (told) {
      EXPECT_EQ(runs[0].measured_torque[1].points()[7].y, 7.5);
    }
    const std::string page = page_of(std::move(runs));
    EXPECT_EQ(count(page, "torques that the arm told") > 0, told.has_value());
  }
}

TEST_F(Report, ShowsARunToItsEndThoughTicksAreMissing) {
  auto messages = support::in_process_log(support::shortened("practical_rigid.yaml", "0.2"));
  std::erase_if(messages, [](const Recorded& message) {
    return message.channel == "ARM_REFERENCE" && message.utime >= 50'000 && message.utime < 100'000;
  });
  const RecordedRun recorded = run("a", messages);
  EXPECT_EQ(recorded.tracking.num_ticks(), 150);
  const Figure figure =
      tracking_figure(recorded.tracking, recorded.label, 0.2, recorded.joints, 500);
  EXPECT_THAT(
      page_of({recorded}),
      HasSubstr(inline_svg(figure, "Positions, errors and torques over time: " + recorded.label)
                    .markup()));
}

TEST_F(Report, SaysThatALogHasNoTruth) {
  auto messages = support::in_process_log(support::shortened("practical_rigid.yaml", "0.1"));
  std::erase_if(messages, [](const Recorded& each) { return each.channel == "ARM_TRUTH"; });
  EXPECT_THAT(page_of({run("a", messages)}),
              AllOf(HasSubstr("In the log: no ARM_TRUTH"), Not(HasSubstr("No torque saturated"))));
}

TEST_F(Report, TakesSaturationAsAShareOfAllTicksOfTheLog) {
  auto messages = support::in_process_log(
      support::shortened("practical_rigid.yaml", "0.2", {"plant.drive.torque_limit_Nm=[200, 20]"}));
  std::erase_if(messages, [](const Recorded& message) {
    return message.channel == "ARM_REFERENCE" && message.utime >= 100'000;
  });
  const RecordedRun recorded = run("a", messages);
  ASSERT_EQ(recorded.tracking.num_ticks(), 100) << "half of the 200";
  const auto percent = [&](std::size_t joint) {
    return static_cast<double>(recorded.saturated[joint].count) / 2;
  };
  ASSERT_GT(percent(0), 0);
  // Both divide by 200, in another order.
  EXPECT_NEAR(recorded.verdict.saturated_share, std::max(percent(0), percent(1)) / 100, 1e-12);
  EXPECT_THAT(results_table({recorded}).markup(),
              HasSubstr(number(fmt::format("{:.3g}", percent(0))).markup() + " %</td>"));
}

TEST_F(Report, LearnsFromTheLogAloneHowTheRunEnded) {
  auto messages = support::in_process_log(support::shortened("practical_rigid.yaml", "0.2"));
  messages.resize(1 + 6 * 150);
  const auto log = write_log("a", messages);
  const auto expect_stopped = [&] {
    const RecordedRun recorded = read_recorded_run(log);
    EXPECT_EQ(recorded.verdict.outcome, study::Outcome::stopped);
    EXPECT_EQ(recorded.verdict.reason, "the log ends after 150 of 200 ticks and does not say why");
    EXPECT_THAT(page_of({recorded}), HasSubstr("does not say why"));
  };
  expect_stopped();
  std::ofstream(log.parent_path() / "summary.json")
      << R"({"run_id": 7, "fault": null, "verdict": "converged: well"})";
  expect_stopped();

  logger::RecordedRun of_the_plant;
  of_the_plant.info.robot = "ARM";
  of_the_plant.run = 7;
  messages.push_back(logger::finished_message(of_the_plant));
  const auto finished = write_log("b", messages);
  EXPECT_FALSE(bad(read_recorded_run(finished).verdict.outcome));
  std::ofstream(finished.parent_path() / "summary.json") << R"({"run_id": 7, "fault": "it fell"})";
  EXPECT_FALSE(bad(read_recorded_run(finished).verdict.outcome));
}

TEST_F(Report, OfALogWithAllTicksAndAFaultSaysThatItWasStopped) {
  auto messages = support::in_process_log(support::shortened("practical_rigid.yaml", "0.1"));
  logger::RecordedRun faulty;
  faulty.info.robot = "ARM";
  faulty.run = 7;
  messages.push_back(logger::fault_message(faulty, "protective stop"));
  const auto log = write_log("a", messages);
  EXPECT_EQ(read_recorded_run(log).verdict.outcome, study::Outcome::stopped);
  EXPECT_EQ(read_recorded_run(log).verdict.reason, "protective stop");
}

TEST_F(Report, PlacesAFaultAtTheLastTickThatAMessageCanName) {
  const RecordedRun recorded =
      run("a", support::in_process_log(support::shortened("regulation.yaml", "0.01")));
  constexpr std::int64_t last = std::numeric_limits<std::int64_t>::max();
  const auto [from_s, to_s] = recorded.seconds({{last, last}}).at(0);
  EXPECT_GT(from_s, 0);
  EXPECT_GE(to_s, from_s);
}

TEST(Visuals, HaveTheMeshesAndNoOtherFiles) {
  const TemporaryDirectory directory;
  for (const char* name : {"arm.stl", "hand.obj", "wood.png", "hull.stl"}) {
    std::ofstream(directory / name) << name;
  }
  const Visuals visuals = read_visuals(
      "<visual><material><texture filename=\"wood.png\"/></material><geometry><mesh "
      "filename=\"arm.stl\"/></geometry></visual><visual><geometry><mesh filename = 'hand.obj'/>"
      "</geometry></visual><collision><mesh filename=\"hull.stl\"/></collision>",
      directory.path());
  EXPECT_THAT(visuals.meshes, ElementsAre(std::pair("arm.stl", base64("arm.stl")),
                                          std::pair("hand.obj", base64("hand.obj"))));
}

TEST(Visuals, FollowNoLinkThatLeadsOutOfTheFolder) {
  const TemporaryDirectory directory;
  std::filesystem::create_directory(directory / "robot");
  std::ofstream(directory / "secret.stl") << "secret";
  std::ofstream(directory / "robot" / "arm.stl") << "arm";
  std::filesystem::create_symlink(directory.path() / "secret.stl", directory / "robot" / "out.stl");
  std::filesystem::create_symlink("arm.stl", directory / "robot" / "in.stl");
  const Visuals visuals =
      read_visuals("<visual><mesh filename=\"out.stl\"/><mesh filename=\"in.stl\"/></visual>",
                   directory.path() / "robot");
  EXPECT_THAT(visuals.meshes, ElementsAre(std::pair("in.stl", base64("arm"))));
}

TEST(Visuals, HaveABoundedNumberOfFaces) {
  const TemporaryDirectory directory;
  const auto repeated = [](std::string_view part, int times) {
    std::string text;
    for (int i = 0; i < times; ++i) text += part;
    return text;
  };
  constexpr int many = 600'000;
  std::ofstream(directory / "triangles.obj") << repeated("f 1 2 3\n", many);
  std::ofstream(directory / "polygon.obj") << "f" << repeated(" 1", many);
  std::ofstream(directory / "continued.obj") << "f" << repeated(" 1\\\n", many);
  std::ofstream(directory / "list.dae") << "<p>" << repeated("1 2 3 ", many) << "</p>";
  std::ofstream(directory / "named.dae") << "<p id=\"x\">" << repeated("1 2 3 ", many) << "</p>";
  std::ofstream(directory / "small.obj") << repeated("v 1 2 3\n", 100'000) << "f 1 2 3\n";
  std::string urdf = "<visual>";
  for (const char* name :
       {"triangles.obj", "polygon.obj", "continued.obj", "list.dae", "named.dae", "small.obj"}) {
    urdf += std::string("<mesh filename=\"") + name + "\"/>";
  }
  const Visuals visuals = read_visuals(urdf + "</visual>", directory.path());
  EXPECT_THAT(visuals.meshes, ElementsAre(testing::Key("small.obj")));
}

TEST_F(Report, MarksWhatDiffersBetweenScenarios) {
  const auto log_of = [&](const std::string& name, const std::vector<std::string>& overrides) {
    return run(name, support::in_process_log(
                         support::shortened("practical_rigid.yaml", "0.01", overrides)));
  };
  std::vector<RecordedRun> runs;
  runs.push_back(log_of("a", {}));
  EXPECT_THAT(page_of({runs[0]}), Not(HasSubstr("What differs")));
  runs.push_back(log_of("b", {}));
  EXPECT_THAT(page_of(runs), HasSubstr("The scenarios are the same."));
  runs.push_back(log_of("c", {"controller.gains.kp=[30000, 2400]", "plant.payload.mass_kg=0.5"}));
  const std::string page = page_of(runs);
  const std::string table = page.substr(page.find("id=\"differences\""));
  const std::string rows = table.substr(0, table.find("</table>"));
  EXPECT_EQ(count(rows, "<tr><th scope=\"row\">"), 2U);
  EXPECT_THAT(rows, HasSubstr("<code>controller.gains.kp</code></th><td>[40000, 2400]\n</td>"
                              "<td>[40000, 2400]\n</td><td class=\"differs\">[30000, 2400]\n"));
  EXPECT_THAT(rows, HasSubstr("<code>plant.payload.mass_kg</code></th><td>–</td><td>–</td>"
                              "<td class=\"differs\">0.5\n</td>"));
  EXPECT_THAT(page, Not(HasSubstr("other joints")));
}

TEST_F(Report, MatchesJointsByNameAndTellsOfOtherRobots) {
  std::vector<RecordedRun> runs;
  const auto two = support::in_process_log(support::shortened("practical_rigid.yaml", "0.05"));
  runs.push_back(run("a", two));
  runs.push_back(run("b", two));
  runs[1].joints.name = {"elbow", "wrist"};
  label(runs);
  const std::vector<ReportSection> sections = report_sections(Overlay(runs));
  ASSERT_EQ(sections[0].charts.size(), 3U);
  // The elbow is joint 2 of one run and joint 1 of the other.
  EXPECT_EQ(sections[0].charts[1].heading, "elbow");
  std::vector<std::pair<std::size_t, double>> last;  // run, last torque, of the elbow
  for (const Curve& curve : sections[2].charts[1].curves) {
    last.emplace_back(curve.run, curve.points.back().y);
  }
  const auto torque = [&](std::size_t i, std::size_t joint) {
    return runs[i].tracking.joints()[joint].torque.final();
  };
  EXPECT_THAT(last, ElementsAre(std::pair{0U, torque(0, 1)}, std::pair{1U, torque(1, 0)}));
  const std::string page = page_of(runs);
  EXPECT_THAT(page, HasSubstr("The robots have other joints: a has 2, b has 2."));
  EXPECT_THAT(page, HasSubstr("Only a has: shoulder; only b has: wrist."));
}

TEST_F(Report, NamesTheLawsSignals) {
  const auto page = [&](const std::string& law, std::vector<std::string> overrides) {
    overrides.push_back("controller.law=" + law);
    return page_of({run(law, support::in_process_log(
                                 support::shortened("practical_rigid.yaml", "0.01", overrides)))});
  };
  EXPECT_THAT(page("loria_ortega_rigid", {}),
              AllOf(HasSubstr("<i>nu</i> [rad/s]"), HasSubstr("in place of the velocity error")));
  EXPECT_THAT(
      page("slotine_li", {"controller.gains={lambda: 20, ks: [100, 10]}"}),
      AllOf(HasSubstr("<i>edot</i> [rad/s]: the velocity error"), Not(HasSubstr("in place of"))));
}

TEST_F(Report, GivesTheRateThatTheLinearisedLoopHas) {
  const RecordedRun recorded =
      run("a", support::in_process_log(support::shortened("practical_rigid.yaml", "1.0")));
  // The slowest mode of the linearised loop decays with 37.0 1/s. The joints and the staircase
  // envelope smear it.
  for (const auto& decay : recorded.decay) {
    ASSERT_TRUE(decay);
    EXPECT_NEAR(decay->rate_per_s, 37.0, 2.0);
  }
  ASSERT_TRUE(recorded.lyapunov_decay);
  EXPECT_NEAR(recorded.lyapunov_decay->rate_per_s, 2 * 37.0, 4.0);  // quadratic in the state
}

TEST_F(Report, ShowsWhatWentWrong) {
  auto messages = support::in_process_log(
      support::shortened("practical_rigid.yaml", "0.2", {"plant.drive.torque_limit_Nm=[200, 20]"}));
  messages.erase(messages.begin() + 1 + 6 * 100 + 3);  // COMMAND of tick 100
  logger::RecordedRun faulty;
  faulty.info.robot = "ARM";
  faulty.run = 7;
  messages.push_back(logger::fault_message(faulty, "<encoder> & cable lost"));
  std::string bytes = logger::log_of(messages);
  bytes.insert(bytes.size() / 2, "garbage");
  const auto path = directory_.path() / "lcmlog";
  logger::write_file(path, bytes);
  const std::string page = page_of({read_recorded_run(path)});
  EXPECT_THAT(page, HasSubstr("In the log: ARM_COMMAND missing in 1 ticks"));
  EXPECT_THAT(page, HasSubstr("Torque of joint 1 (shoulder) saturated"));
  EXPECT_THAT(page, HasSubstr("Fault of the controller at tick 17: &lt;encoder&gt; &amp; cable"));
  EXPECT_THAT(page, HasSubstr("The log is damaged"));
  EXPECT_THAT(page, Not(HasSubstr("<encoder>")));
  EXPECT_THAT(page, HasSubstr("<figure id=\"events-1\" class=\"live wide\""));
}

TEST_F(Report, NamesALawThatThisVersionDoesNotKnow) {
  auto messages = support::in_process_log(support::shortened("practical_rigid.yaml", "0.1"));
  std::string& info = messages[0].data;
  const std::string law = "loria_ortega_rigid";
  for (std::size_t at = info.find(law); at != std::string::npos; at = info.find(law, at)) {
    info.replace(at, law.size(), "loria_ortega_frigi");
  }
  EXPECT_THAT(page_of({run("a", messages)}), HasSubstr("loria_ortega_frigi"));
}

TEST_F(Report, IsMadeOfARunWhoseReferenceIsATableThatTheLogDoesNotHold) {
  const std::filesystem::path table = directory_.path() / "two.csv";
  std::ofstream(table) << "0,0,0\n5,0,0\n";
  const scenario::Scenario scenario = support::shortened(
      "practical_rigid.yaml", "0.1", {"reference={file: '" + table.string() + "'}"});
  const auto messages = support::in_process_log(scenario);
  std::filesystem::remove(table);
  const RecordedRun found = run("a", messages);
  EXPECT_EQ(found.verdict.word(), "converged") << found.verdict.reason;
  EXPECT_EQ(found.verdict.stiffness, 0);  // unknown stiffness
  EXPECT_THAT(page_of({found}), HasSubstr("two.csv"));
}

TEST_F(Report, NamesAChangeOfGains) {
  auto messages = support::in_process_log(support::shortened("practical_rigid.yaml", "0.1"));
  set_gains(messages, 40, 100);
  EXPECT_THAT(page_of({run("a", messages)}),
              AllOf(HasSubstr("Gains of the law from tick 40: kp=300,100"),
                    HasSubstr("No torque saturated, no command was missed")));
}

/// The bound holds for a run under one law from its start.
TEST_F(Report, HoldsVToNoBoundOnceTheGainsWereOthers) {
  auto messages = support::in_process_log(support::shortened("practical_rigid.yaml", "0.1"));
  const double V0 = run("alone", messages).lyapunov.points().front().y;
  const auto violated = [&](const std::string& name) {
    // The bound begins far above V and falls below it within 8 ms, while V falls by exp(-0.6).
    lyapunov::CertifiedRun steep;
    steep.V0 = 1e3 * V0;
    steep.level = V0;
    steep.rate = 1000;
    return read_recorded_run(write_log(name, messages), {},
                             [&](const auto&) { return std::optional(steep); })
        .above_bound_s;
  };
  EXPECT_TRUE(violated("a"));
  set_gains(messages, 1, 5);
  EXPECT_FALSE(violated("b"));
}

TEST_F(Report, OverlaysRunsWithALegend) {
  const auto messages = support::in_process_log(support::shortened("practical_rigid.yaml", "0.1"));
  const auto flexible =
      support::in_process_log(support::shortened("practical_flexible.yaml", "0.1"));
  const std::string page =
      page_of({run("first", messages), run("second", messages), run("third", flexible)});
  EXPECT_THAT(page, AllOf(HasSubstr("</svg>first"), HasSubstr("</svg>second"),
                          HasSubstr("</svg>third"), HasSubstr("class=\"legend\"")));
  EXPECT_EQ(count(page, "<figure id=\"tracking-1\""), 1U);
}

TEST_F(Report, LabelsRunsByWhatTellsThemApart) {
  std::vector<RecordedRun> runs;
  const auto messages = support::in_process_log(support::shortened("regulation.yaml", "0.01"));
  runs.push_back(run("a", messages));
  label(runs);
  EXPECT_EQ(runs[0].label, "regulation");
  runs.push_back(
      run("b", support::in_process_log(support::shortened("practical_rigid.yaml", "0.01"))));
  label(runs);
  EXPECT_EQ(runs[1].label, "practical_rigid");
  runs.pop_back();
  runs.push_back(run("b", support::in_process_log(support::shortened(
                              "regulation.yaml", "0.01", {"controller.law=kelly_regulation"}))));
  label(runs);
  EXPECT_EQ(runs[1].label, "kelly_regulation");
  runs.push_back(run("c", messages));
  label(runs);
  EXPECT_EQ(runs[2].label, "c");
}

TEST_F(Report, GivesItsScriptsEveryTickOfAShortRun) {
  std::vector<RecordedRun> runs;
  runs.push_back(
      run("a", support::in_process_log(support::shortened("practical_rigid.yaml", "1"))));
  runs[0].label = "</script><script>alert(1)";
  const Overlay all(runs);
  const std::string text = page_data(all, report_sections(all));
  EXPECT_THAT(text, Not(HasSubstr("<")));
  const auto data = base::parse_json(text);
  EXPECT_EQ(data["end_s"], 1.0);
  EXPECT_EQ(data["runs"][0]["bodies"].size(), 4U) << "two links and their rotors";
  std::vector<std::string> names;
  for (const auto& chart : data["charts"]) names.push_back(chart["name"]);
  EXPECT_THAT(names, ElementsAre("tracking-1", "tracking-2", "error-1", "error-2", "torque-1",
                                 "torque-2", "controller-1", "controller-2", "lyapunov-v"));
  // 1,000 ticks of two 32-bit floats are 8,000 bytes; base64 writes 3 bytes as 4 letters.
  const auto& curve = data["charts"][0]["curves"][0];
  EXPECT_EQ(curve["signal"], "q");
  EXPECT_EQ(curve["points"].get<std::string>().size(), 10'668U);
  EXPECT_EQ(data["charts"][0]["label"], "<i>q</i><sub>1</sub> [rad]");
}

TEST_F(Report, DoesNotTakeAnotherRunsSummary) {
  const auto log =
      write_log("a", support::in_process_log(support::shortened("regulation.yaml", "0.01")));
  for (const char* text : {R"({"run_id": 8, "wall_s": 1})", "[]", "{", "", R"({"run_id": "7"})"}) {
    std::ofstream(log.parent_path() / "summary.json") << text;
    EXPECT_TRUE(read_recorded_run(log).outcome.is_null()) << text;
  }
}

TEST_F(Report, SaysWhereItCannotWrite) {
  std::vector<RecordedRun> runs;
  runs.push_back(run("a", support::in_process_log(support::shortened("regulation.yaml", "0.01"))));
  try {
    write_report(runs, "/nowhere/report.html");
    FAIL();
  } catch (const base::Failure& failure) {
    EXPECT_EQ(failure.code(), base::ExitCode::bad_usage);
    EXPECT_THAT(failure.what(), HasSubstr("/nowhere/report.html"));
  }
}

}  // namespace
}  // namespace tachless::report
