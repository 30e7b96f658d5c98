// The studies as their pages tell to make them: the command is taken from the page, made smaller,
// and what the page says is looked for in the results.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <map>
#include <regex>

#include "certify/prediction.h"
#include "lyapunov/stability_certificate.h"
#include "study/sweep.h"
#include "tests/support/program.h"
#include "tests/support/temporary_directory.h"

namespace tachless::studies_test {
namespace {

using study::SweepRow;
using testing::HasSubstr;

class Study : public testing::Test {
 protected:
  /// Runs the page's command with each text of `smaller` put in place of its key.
  /// @return the rows
  std::vector<SweepRow> run(const std::string& name,
                            const std::map<std::string, std::string>& smaller) {
    const std::string page = contents(root_ + "/docs/studies/" + name + ".md");
    EXPECT_THAT(page, HasSubstr("](../figures/" + name + ".svg)"));
    std::smatch found;
    if (!std::regex_search(page, found, std::regex("```\n\\./(tachless sweep [^`]*)```"))) {
      throw std::runtime_error(name + ": no command on its page");
    }
    std::string command = found[1];
    EXPECT_THAT(command, HasSubstr("scenarios/" + name + ".yaml"));
    for (const auto& [from, to] : smaller) {
      const std::size_t at = command.find(from);
      if (at == std::string::npos) throw std::runtime_error(name + ": not on its page: " + from);
      command.replace(at, from.size(), to);
    }
    command.pop_back();  // the line's end
    const std::string out = (temporary_ / "out").string();
    Program program("bash",
                    {"-c", "cd " + root_ + " && exec " TACHLESS_BINARY_DIR "/bin/" + command +
                               " --quiet --out " + out},
                    temporary_.path());
    if (program.wait() != 0) throw std::runtime_error(program.errors());
    map_ = contents(temporary_ / "out" / "map.svg");
    sweep_.emplace(study::Sweep::open(out));
    return sweep_->rows();
  }

  [[nodiscard]] const study::SweepPlan& plan() const { return sweep_->plan(); }

  std::string map_;

 private:
  const std::string root_ = TACHLESS_SOURCE_DIR;
  TemporaryDirectory temporary_;
  std::optional<study::Sweep> sweep_;
};

double measured(const SweepRow& row, std::string_view name) {
  const auto columns = study::measure_columns();
  const auto found = std::ranges::find(columns, name, &study::MeasureColumn::name);
  return row.measures.at(static_cast<std::size_t>(found - columns.begin()));
}

/// One measure of the run of that law at these values.
double at(const std::vector<SweepRow>& rows, const std::string& law, double first, double second,
          std::string_view name) {
  for (const SweepRow& row : rows) {
    if (row.which.law == law && row.which.values[0] == first &&
        (row.which.values.size() < 2 || row.which.values[1] == second)) {
      return measured(row, name);
    }
  }
  throw std::runtime_error("no run of " + law);
}

bool bad(const SweepRow& row) { return study::bad(row.outcome); }

TEST_F(Study, EncoderShowsCountsWhenSlowAndLagWhenFast) {
  const auto rows = run("study_encoder", {{"12:24:7", "12,16,22"}});
  const auto of = [&](const std::string& law, double bits, double hz, std::string_view name) {
    return at(rows, law, bits, hz, name);
  };
  for (const char* law : {"numerical_difference", "kalman_velocity"}) {
    // Slow: four bits are a factor 16 when counts are all there is.
    EXPECT_GT(of(law, 12, 0.5, "velocity_error"), 8 * of(law, 16, 0.5, "velocity_error"));
    // Fast: six more bits do nothing.
    EXPECT_NEAR(of(law, 16, 5, "velocity_error") / of(law, 22, 5, "velocity_error"), 1, 0.05);
    EXPECT_GT(of(law, 16, 5, "settled_error"),
              100 * of("loria_ortega_rigid", 16, 5, "settled_error"));
  }
  EXPECT_GT(of("loria_ortega_rigid", 16, 5, "velocity_error"),
            30 * of("loria_ortega_rigid", 22, 5, "velocity_error"));
  EXPECT_LT(of("loria_ortega_rigid", 22, 5, "settled_error"),
            1.1 * of("wen_bayard", 22, 5, "settled_error"));
  // It is the error that is filtered, and not the filter, that does it.
  for (const double hz : {0.5, 5.0}) {
    EXPECT_NEAR(of("difference_of_error", 16, hz, "settled_error") /
                    of("loria_ortega_rigid", 16, hz, "settled_error"),
                1, 0.1);
    EXPECT_GT(of("loria_ortega_rigid", 12, hz, "torque_variation"),
              1.3 * of("difference_of_error", 12, hz, "torque_variation"));
  }
  // The price is a rougher torque.
  for (const double hz : {0.5, 5.0}) {
    EXPECT_GT(of("loria_ortega_rigid", 12, hz, "torque_variation"),
              1.3 * of("numerical_difference", 12, hz, "torque_variation"));
    EXPECT_GT(of("nicosia_tomei", 12, hz, "torque_variation"),
              1.5 * of("loria_ortega_rigid", 12, hz, "torque_variation"));
  }
  EXPECT_TRUE(std::isnan(of("wen_bayard", 12, 5, "velocity_error")));  // it is given the velocity
  // A row of two diagrams for each of the three measures.
  for (const char* words : {"frequency_hz = 0.5", "frequency_hz = 5", "velocity_error [rad/s]",
                            "settled_error", "torque_variation", "numerical_difference"}) {
    EXPECT_THAT(map_, HasSubstr(words));
  }
}

TEST_F(Study, PayloadMakesTheLawsAlike) {
  const auto rows = run("study_payload", {{"0:0.85:18", "0,0.1,0.85"}});
  const auto spread = [&](double mass, double hz, const std::vector<std::string>& laws) {
    double least = INFINITY, most = 0;
    for (const std::string& law : laws) {
      const double error = at(rows, law, mass, hz, "settled_error");
      least = std::min(least, error);
      most = std::max(most, error);
    }
    return most / least;
  };
  const std::vector<std::string> alike = {"loria_ortega_rigid", "wen_bayard", "slotine_li",
                                          "berghuis_nijmeijer", "nicosia_tomei"};
  std::vector<std::string> all = alike;
  all.insert(all.end(), {"kalman_velocity", "computed_torque"});
  EXPECT_GT(spread(0, 5, all), 100);
  EXPECT_LT(spread(0.85, 5, all), 1.3);
  EXPECT_LT(spread(0.85, 0.5, alike), 1.03);
  EXPECT_GT(at(rows, "loria_ortega_rigid", 0.1, 5, "settled_error"),
            at(rows, "kalman_velocity", 0, 5, "settled_error"));
  EXPECT_GT(at(rows, "loria_ortega_rigid", 0.85, 5, "settled_error"),
            4 * at(rows, "loria_ortega_rigid", 0.1, 5, "settled_error"));
}

TEST_F(Study, DelayIsBorneUpToTheLinearisedLoopsLimit) {
  const auto rows = run("study_delay", {{"5e-4:2e-2:25:log", "5e-4:2e-2:13:log"}});
  std::map<std::pair<std::string, double>, double> limits;
  int beyond = 0;
  for (const SweepRow& row : rows) {
    const double period = row.which.values[0];
    const auto [limit, unknown] = limits.try_emplace({row.which.law, row.which.values[1]}, 0);
    if (unknown) {
      const scenario::Scenario scenario = plan().scenario(row.which);
      limit->second = certify::analyse(scenario, linear::Effort::quick).limit_s.value();
    }
    const bool near_reference = !bad(row) && measured(row, "settled_error") < 0.05;
    SCOPED_TRACE(testing::Message() << row.which.law << " " << period << " of " << limit->second);
    // Within 10 % of the limit errors change too slowly to be judged after 2 s.
    if (period < 0.9 * limit->second) {
      EXPECT_TRUE(near_reference);
    } else if (period > 1.1 * limit->second) {
      EXPECT_FALSE(near_reference);
      ++beyond;
    }
  }
  EXPECT_GT(beyond, 15);
  const auto limit = [&](const std::string& law, double delay) { return limits.at({law, delay}); };
  EXPECT_LT(limit("loria_ortega_rigid", 1), 0.5 * limit("loria_ortega_rigid", 0));
  EXPECT_NEAR(limit("loria_ortega_rigid", 1) / limit("wen_bayard", 1), 0.8, 0.05);
  EXPECT_NEAR(limit("nicosia_tomei", 1) / limit("wen_bayard", 1), 1, 0.01);
  EXPECT_THAT(map_, HasSubstr("diverging, stopped"));
}

TEST_F(Study, FlexibilityIsBorneByTheLawsThatKnowOfIt) {
  const auto rows = run("study_flexibility", {{"1e2:1e6:17:log", "1e2,1e4,1e5,1e6"}});
  const auto error = [&](const std::string& law, double stiffness) {
    return at(rows, law, stiffness, 0, "settled_error");
  };
  EXPECT_TRUE(std::isnan(error("loria_ortega_rigid", 1e2)));  // diverged
  EXPECT_GT(error("loria_ortega_rigid", 1e4), 30 * error("loria_ortega_rigid", 1e5));
  for (const double stiffness : {1e2, 1e4, 1e5}) {
    EXPECT_LT(error("loria_ortega_flexible", stiffness), 5e-5);
    EXPECT_LT(error("loria_ortega_flexible", stiffness),
              2 * error("slotine_li_flexible", stiffness));
  }
  EXPECT_GT(error("motor_pd_feedforward", 1e2), 100 * error("loria_ortega_flexible", 1e2));
  // Beyond the limit of the clock; the rigid law is not.
  EXPECT_TRUE(std::isnan(error("loria_ortega_flexible", 1e6)));
  EXPECT_LT(error("loria_ortega_rigid", 1e6), 1e-4);
}

TEST_F(Study, AttractionIsCertifiedFurtherWithALargerB) {
  const auto rows =
      run("study_attraction", {{"1:1000:13:log", "1,10,100"}, {"0.1:50:13", "0.1:50:5"}});
  std::map<double, double> farthest;
  for (const SweepRow& row : rows) {
    EXPECT_FALSE(bad(row)) << row.which.index;
    const double b = row.which.values[0], start = row.which.values[1];
    const auto run = lyapunov::certified_run(plan().scenario(row.which));
    if (run && run->rate >= 0) farthest[b] = std::max(farthest[b], start);
    EXPECT_EQ((row.outcome == study::Outcome::converged), b == 100) << row.which.index;
  }
  EXPECT_EQ(farthest.count(1), 0U);
  EXPECT_GT(farthest[10], 1);
  EXPECT_GT(farthest[100], 2 * farthest[10]);
  EXPECT_THAT(map_, HasSubstr("converged"));
}

TEST_F(Study, AdaptationMakesTheErrorIndependentOfTheLoad) {
  const auto rows = run("study_adaptive", {{"0:1:11", "0,1"}});
  const auto error = [&](const std::string& law, double mass) {
    return at(rows, law, mass, 0, "settled_error");
  };
  EXPECT_LT(error("loria_ortega_adaptive", 1), 3 * error("loria_ortega_adaptive", 0));
  EXPECT_GT(error("loria_ortega_integral", 1), 50 * error("loria_ortega_adaptive", 1));
  EXPECT_GT(error("linear_adrc", 1), 10 * error("loria_ortega_adaptive", 1));
  EXPECT_LT(error("loria_ortega_integral", 1), 0.9 * error("loria_ortega_rigid", 1));
}

TEST_F(Study, BoundedTorqueBringsEveryStartBack) {
  const auto rows = run("study_bounded", {{"--random 250", "--random 8"}});
  EXPECT_EQ(rows.size(), 8U);
  for (const SweepRow& row : rows) {
    EXPECT_EQ(row.outcome, study::Outcome::converged) << row.which.index;
    EXPECT_LT(measured(row, "settled_error"), 1e-4);
  }
}

}  // namespace
}  // namespace tachless::studies_test
