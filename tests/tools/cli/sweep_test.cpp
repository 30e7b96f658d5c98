#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <csignal>
#include <nlohmann/json.hpp>
#include <regex>
#include <thread>

#include "base/json_text.h"
#include "tests/support/program.h"
#include "tests/support/shell.h"
#include "tests/support/temporary_directory.h"

namespace tachless::sweep_test {
namespace {

using testing::HasSubstr;
using testing::Not;

const std::string scenario = TACHLESS_SOURCE_DIR "/scenarios/practical_rigid.yaml";

/// A sweep of 60 runs of 0.2 s each.
std::vector<std::string> sweep(const std::string& out) {
  return {"sweep",  scenario,
          "--set",  "plant.mechanics=native",
          "--set",  "loop.duration_s=0.2",
          "--vary", "controller.gains.kp*=0.1:10:12:log",
          "--vary", "controller.gains.kd*=0.1:3:5:log",
          "--out",  out};
}

class SweepVerb : public testing::Test {
 protected:
  std::string directory(const std::string& name) { return (temporary_ / name).string(); }
  Program start(const std::vector<std::string>& arguments) {
    return {"tachless", arguments, temporary_.path()};
  }
  TemporaryDirectory temporary_;
};

TEST_F(SweepVerb, KilledFiveTimesEndsInTheSameTable) {
  Program whole = start(sweep(directory("whole")));
  ASSERT_EQ(whole.wait(), 0) << whole.errors();
  const auto rows = [&] {
    const std::string text = contents(temporary_ / "killed" / "rows-1-of-1.csv");
    return std::count(text.begin(), text.end(), '\n');
  };
  for (int kill = 0; kill < 5; ++kill) {
    const auto before = kill == 0 ? 0 : rows();
    Program program = start(sweep(directory("killed")));
    while (program.running() &&
           (!exists(temporary_ / "killed" / "rows-1-of-1.csv") || rows() < before + 5)) {
      std::this_thread::yield();
    }
    program.signal(kill % 2 == 0 ? SIGKILL : SIGINT);
    const int code = program.wait();
    if (kill % 2 != 0 && code != 0) {
      EXPECT_THAT(program.errors(), HasSubstr("interrupted; to resume it: tachless sweep "));
    }
  }
  // Its directory is enough to go on.
  Program last = start({"sweep", directory("killed"), "--json"});
  ASSERT_EQ(last.wait(), 0) << last.errors();
  EXPECT_EQ(contents(temporary_ / "killed" / "results.csv"),
            contents(temporary_ / "whole" / "results.csv"));
  const auto summary = base::parse_json(last.output());
  EXPECT_EQ(summary.at("runs"), 60);
  EXPECT_THAT(contents(temporary_ / "killed" / "index.html"), HasSubstr("<svg"));
  EXPECT_THAT(contents(temporary_ / "killed" / "map.svg"), HasSubstr("diverging"));
}

TEST_F(SweepVerb, InPartsIsMergedWhenAllAreThere) {
  std::vector<std::string> arguments = sweep(directory("parts"));
  arguments.insert(arguments.end(), {"--shard", "1/2"});
  Program first = start(arguments);
  ASSERT_EQ(first.wait(), 0) << first.errors();
  EXPECT_FALSE(exists(temporary_ / "parts" / "results.csv"));
  Program early = start({"sweep", directory("parts"), "--merge"});
  EXPECT_EQ(early.wait(), 1);
  EXPECT_THAT(early.errors(), HasSubstr("30 of 60 runs are not finished"));
  Program second = start({"sweep", directory("parts"), "--shard", "2/2"});
  ASSERT_EQ(second.wait(), 0) << second.errors();
  Program merge = start({"sweep", directory("parts"), "--merge"});
  ASSERT_EQ(merge.wait(), 0) << merge.errors();
  Program whole = start(sweep(directory("whole")));
  ASSERT_EQ(whole.wait(), 0) << whole.errors();
  EXPECT_EQ(contents(temporary_ / "parts" / "results.csv"),
            contents(temporary_ / "whole" / "results.csv"));
}

TEST_F(SweepVerb, DrawsWhereCertifiedStartsEnd) {
  const auto map = [&](const std::string& name, const std::string& second) {
    Program program =
        start({"sweep", scenario, "--set", "plant.mechanics=native", "--set",
               "loop.duration_s=0.02", "--vary", "plant.initial.position_rad[0]=-20:20:3", "--vary",
               second, "--out", directory(name)});
    EXPECT_EQ(program.wait(), 0) << program.errors();
    return contents(temporary_ / name / "map.svg");
  };
  EXPECT_THAT(map("positions", "plant.initial.position_rad[1]=-80:80:3"), HasSubstr("certified"));
  EXPECT_THAT(map("others", "plant.initial.velocity_rad_per_s[1]=-1:1:3"),
              Not(HasSubstr("certified")));
}

TEST_F(SweepVerb, SaysWhatIsWrong) {
  const auto refused = [&](std::vector<std::string> arguments, const std::string& words) {
    Program program = start(arguments);
    EXPECT_EQ(program.wait(), 2);
    EXPECT_THAT(program.errors(), HasSubstr(words));
  };
  refused({"sweep", scenario}, "nothing to vary: name it with --vary");
  refused({"sweep", temporary_.path().string()}, "there is no plan.json");
  refused({"sweep", scenario, "--vary", "loop.duration_s=1,2", "--shard", "3/2"},
          "--shard 3/2: allowed: I/N");
  refused({"sweep", scenario, "--vary", "loop.duration_s=0.1,0.2", "--colour", "blue", "--out",
           directory("colour")},
          "--colour blue: no measure; allowed: outcome, peak_error");
  EXPECT_FALSE(exists(temporary_ / "colour" / "rows-1-of-1.csv")) << "before any run";
  refused({"sweep", scenario, "--vary", "loop.duration_s=0.1,0.2", "--laws", "loria", "--out",
           directory("law")},
          "did you mean loria_ortega_rigid?");
}

TEST_F(SweepVerb, ComparesLaws) {
  Program program =
      start({"compare", scenario, "--set", "plant.mechanics=native", "--set", "loop.duration_s=0.5",
             "--laws", "loria_ortega_rigid,slotine_li", "--json", "--out", directory("compare")});
  ASSERT_EQ(program.wait(), 0) << program.errors();
  const auto laws = base::parse_json(program.output()).at("laws");
  ASSERT_EQ(laws.size(), 2U);
  EXPECT_EQ(laws[0].at("law"), "loria_ortega_rigid");
  EXPECT_EQ(laws[1].at("set")[1], "controller.law=slotine_li");
  // At the same bandwidth, velocity from positions makes more of the encoder's counts.
  EXPECT_GT(laws[0].at("torque_noise"), laws[1].at("torque_noise"));
  EXPECT_GT(laws[1].at("largest_period_s"), 1e-3);
  EXPECT_THAT(contents(temporary_ / "compare" / "index.html"), HasSubstr("torque_noise"));
  // Its directory is enough to print the table again.
  Program again = start({"sweep", directory("compare")});
  ASSERT_EQ(again.wait(), 0) << again.errors();
  EXPECT_THAT(again.output(), HasSubstr("\n  slotine_li          converged"));
}

/// Each by `design`, with the same margin and so much torque per count; what has no gains has no
/// row.
TEST_F(SweepVerb, ComparesLawsAtOneMargin) {
  Program program =
      start({"compare", scenario, "--set", "plant.mechanics=native", "--set", "loop.duration_s=0.2",
             "--laws", "difference_of_error,robust_differentiator", "--margin", "0.6", "--noise",
             "0.05,0.5", "--json", "--out", directory("margin")});
  ASSERT_EQ(program.wait(), 0) << program.errors();
  EXPECT_THAT(program.errors(), HasSubstr("compare: robust_differentiator has no row: "));
  const auto laws = base::parse_json(program.output()).at("laws");
  ASSERT_EQ(laws.size(), 2U);
  EXPECT_LT(laws[0].at("torque_noise"), laws[1].at("torque_noise"));
  EXPECT_GT(laws[0].at("rms_error"), laws[1].at("rms_error"));
  std::vector<std::string> certify = {"certify", scenario, "--json"};
  for (const nlohmann::json& set : laws[1].at("set")) {
    certify.insert(certify.end(), {"--set", set.get<std::string>()});
  }
  Program check = start(certify);
  ASSERT_EQ(check.wait(), 0) << check.errors();
  const auto sampled = base::parse_json(check.output()).at("sampled");
  EXPECT_NEAR(sampled.at("margins").at("modulus"), 0.6, 0.005);
  EXPECT_LE(sampled.at("count_torque_Nm")[0], 0.5);
}

}  // namespace
}  // namespace tachless::sweep_test
