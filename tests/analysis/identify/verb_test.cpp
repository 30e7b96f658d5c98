// The commands `tachless excite` and `tachless identify`: the files they write and their refusals.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "base/json_text.h"
#include "tests/support/program.h"
#include "tests/support/shell.h"
#include "tests/support/temporary_directory.h"

namespace tachless::verb_test {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;
using Words = std::vector<std::string>;

class IdentifyVerb : public testing::Test {
 protected:
  struct Result {
    int code;
    std::string output, errors;
  };

  Result tachless(const Words& words) const {
    Program program("tachless", words, directory_.path());
    const int code = program.wait();
    return {code, program.output(), program.errors()};
  }

  /// Runs the two-link arm with friction. Returns the run's directory.
  [[nodiscard]] std::string run(const std::string& name, Words more) const {
    Words words = {
        "run",
        TACHLESS_SOURCE_DIR "/scenarios/practical_rigid.yaml",
        "--in-process",
        "--quiet",
        "--any-outcome",
        "--out",
        directory_ / name,
        "--set",
        "plant.mechanics=native",
        "--set",
        "plant.drive.viscous_friction_Nms_per_rad=[2, 1]",
        "--set",
        "plant.drive.coulomb_friction_Nm=[5, 0.5]",
        "--set",
        "reference={multi_sine: {terms: [{amplitude_rad: 0.5, frequency_hz: [0.3, 0.4]}, "
        "{amplitude_rad: 0.2, frequency_hz: [0.8, 1.1]}]}}"};
    words.insert(words.end(), more.begin(), more.end());
    const Result result = tachless(words);
    EXPECT_EQ(result.code, 0) << result.errors;
    return directory_ / name;
  }

  /// Returns the log of that run without changes, which the first test that asks for it makes.
  [[nodiscard]] std::string usual_log() const {
    static const TemporaryDirectory kept;
    static const std::string log = [&] {
      fs::copy(run("usual", {}), kept / "usual", fs::copy_options::recursive);
      return kept / "usual";
    }();
    return log;
  }

  void expect_refusal(Words words, const std::string& says) const {
    words.insert(words.begin(), "identify");
    words.insert(words.end(), {"--write", directory_ / "refused.yaml"});
    const Result result = tachless(words);
    EXPECT_EQ(result.code, 2);
    EXPECT_THAT(result.errors, HasSubstr(says));
    EXPECT_EQ(std::ranges::count(result.errors, '\n'), 1) << result.errors;
    EXPECT_FALSE(fs::exists(directory_ / "refused.yaml"));
  }

  TemporaryDirectory directory_;
};

TEST_F(IdentifyVerb, WritesAScenarioThatDesignTakesAndReplacesNothing) {
  const std::string log = usual_log(), other = run("other", {"--set", "loop.duration_s=3"});
  const Words words = {"identify", log,       "--validate",          other,
                       "--quiet",  "--write", directory_ / "f.yaml", "--json"};
  const Result result = tachless(words);
  ASSERT_EQ(result.code, 0) << result.errors;
  const auto found = base::parse_json(result.output);
  EXPECT_TRUE(found["validated"].get<bool>());
  // The interval from 5 s of data at 20 bits is about 1e-3 of the value.
  EXPECT_NEAR(found["parameters"][2]["value"].get<double>(), 2, 0.02);
  EXPECT_NEAR(found["parameters"][4]["value"].get<double>(), 5, 0.02);
  EXPECT_LT(found["joints"][1]["torque_error"].get<double>(), 0.01);
  EXPECT_EQ(tachless({"certify", directory_ / "f.yaml", "--quiet"}).code, 0);
  EXPECT_THAT(contents(directory_ / "f.yaml"),
              AllOf(HasSubstr("urdf: f.urdf"), HasSubstr("rotor_inertia_kgm2: ["),
                    HasSubstr("coulomb_friction_Nm: [")));
  const Result again = tachless(words);
  EXPECT_EQ(again.code, 2);
  EXPECT_THAT(again.errors, HasSubstr("f.yaml: exists already"));
  EXPECT_EQ(tachless({"identify", log, "--validate", other, "--validate", log}).code, 2) << "one";
  const Result fitted = tachless({"identify", log, "--validate", log});
  EXPECT_EQ(fitted.code, 2);
  EXPECT_THAT(fitted.errors, HasSubstr("is one of the fitted logs; allowed: another log"));
  for (const auto& [file, says] :
       {std::pair{"f.urdf", "ends with .yaml"}, {"nowhere/g.yaml", "cannot be written"}}) {
    const Result refused = tachless({"identify", log, "--write", directory_ / file});
    EXPECT_EQ(refused.code, 2);
    EXPECT_THAT(refused.errors, HasSubstr(says));
    EXPECT_EQ(std::ranges::count(refused.errors, '\n'), 1) << refused.errors;
  }
}

TEST_F(IdentifyVerb, SuggestsADesignForTheIntervalsOfTheRotors) {
  const std::string fine = usual_log();
  const std::string coarse =
      run("coarse", {"--set", "plant.encoder.resolution_bits=9", "--set", "loop.duration_s=3"});
  const auto suggested = [&](const std::string& log, const std::string& file) {
    return tachless({"identify", log, "--write", directory_ / file, "--quiet"}).output;
  };
  EXPECT_THAT(suggested(fine, "fine.yaml"), HasSubstr("fine.yaml\n"));
  const std::string output = suggested(coarse, "coarse.yaml");
  EXPECT_THAT(output, testing::ContainsRegex("coarse.yaml --uncertain rotors=[0-9.e-]+/"));
  // The option is the one that design reads, with the intervals that identify prints.
  const std::string option = output.substr(output.find(" rotors=") + 1);
  const Result designed = tachless({"design", directory_ / "coarse.yaml", "--quiet", "--json",
                                    "--uncertain", option.substr(0, option.find('\n'))});
  ASSERT_EQ(designed.code, 0) << designed.errors;
  EXPECT_TRUE(base::parse_json(designed.output).contains("uncertain"));
}

TEST_F(IdentifyVerb, FromABareUrdfToGainsForTheArmThatIsThere) {
  const std::string urdf = TACHLESS_SOURCE_DIR "/scenarios/robots/two_link.urdf";
  const auto step = [&](const Words& words) {
    const Result result = tachless(words);
    EXPECT_EQ(result.code, 0) << words.front() << ": " << result.errors;
    return result.output;
  };
  step({"design", urdf, "--write", directory_ / "soft.yaml", "--settling", "1", "--quiet"});
  EXPECT_THAT(step({"excite", directory_ / "soft.yaml", "--write", directory_ / "move.yaml",
                    "--duration", "10", "--quiet"}),
              HasSubstr("type: tachless run"));
  // The emulated arm has friction, a gear's rotors and 16 bits. Neither identify nor the law reads
  // the plant's keys for them.
  step({"run", directory_ / "move.yaml", "--in-process", "--quiet", "--any-outcome", "--out",
        directory_ / "move", "--set", "plant.mechanics=native", "--set",
        "plant.drive.coulomb_friction_Nm=[4, 0.6]", "--set",
        "plant.drive.viscous_friction_Nms_per_rad=[3, 0.7]", "--set",
        "plant.encoder.resolution_bits=16"});
  step({"identify", directory_ / "move", "--write", directory_ / "known.yaml", "--quiet"});
  step({"design", directory_ / "known.yaml", "--write", directory_ / "stiff.yaml", "--quiet"});
  const std::string text = contents(directory_ / "stiff.yaml");
  EXPECT_THAT(text, AllOf(HasSubstr("coulomb: ["), HasSubstr("viscous: [")));
  step(
      {"run", directory_ / "stiff.yaml", "--in-process", "--quiet", "--out", directory_ / "stiff"});
}

TEST_F(IdentifyVerb, FindsLinksFromTheTableOfAnotherLogger) {
  // Any program's table would serve. This table is exported from a run of an arm with a heavier
  // forearm, and read without the run's controller.
  const std::string log =
      run("log", {"--set", "plant.payload={mass_kg: 0.4, center_of_mass_m: [0, 0, -0.1]}"});
  ASSERT_EQ(tachless({"export", log, "-o", directory_ / "run.csv"}).code, 0);
  std::ifstream table(directory_ / "run.csv");
  std::string header;
  std::getline(table, header);
  const auto column = [&](const std::string& name) {
    return std::to_string(
        1 + std::count(header.begin(), header.begin() + static_cast<long>(header.find(name)), ','));
  };
  std::ofstream(directory_ / "run.yaml")
      << "scenario: " TACHLESS_SOURCE_DIR "/scenarios/practical_rigid.yaml\ntable: run.csv\n"
      << "time_column: " << column("t_s") << "\nposition_columns: ["
      << column("q_measured_shoulder") << ", " << column("q_measured_elbow")
      << "]\ntorque_columns: [" << column("tau_applied_shoulder") << ", "
      << column("tau_applied_elbow") << "]\n";
  const Result result = tachless({"identify", directory_ / "run.yaml", "--all", "--write",
                                  directory_ / "known.yaml", "--quiet", "--json"});
  ASSERT_EQ(result.code, 0) << result.errors;
  const auto found = base::parse_json(result.output);
  EXPECT_EQ(found["method"], "least squares");
  for (const auto& joint : found["joints"]) {
    EXPECT_LT(joint["torque_error"].get<double>(), 0.02) << joint;
    EXPECT_FALSE(joint.contains("position_error"));
  }
  // The payload is now part of the last link, in the scenario and in its URDF.
  const Result robot = tachless({"robot", directory_ / "known.urdf"});
  EXPECT_EQ(robot.code, 0) << robot.errors;
  EXPECT_THAT(contents(directory_ / "known.yaml"), HasSubstr("urdf: known.urdf"));
  EXPECT_EQ(tachless({"certify", directory_ / "known.yaml", "--quiet"}).code, 0);
  EXPECT_EQ(tachless({"identify", log, "--all", "--unknown", "rotor"}).code, 2);
}

TEST_F(IdentifyVerb, ExciteStaysWithinLimitsAndIsRefusedWhereItCannot) {
  const std::string arm = TACHLESS_SOURCE_DIR "/scenarios/practical_rigid.yaml";
  const auto excite = [&](Words more) {
    Words words = {"excite",     arm, "--write", directory_ / "move.yaml",
                   "--duration", "5", "--quiet"};
    words.insert(words.end(), more.begin(), more.end());
    return tachless(words);
  };
  // The gains are too fast for 20 ms, so nothing is written.
  const Result unstable = excite({"--set", "loop.period_s=0.02"});
  EXPECT_EQ(unstable.code, 1);
  EXPECT_THAT(unstable.errors, AllOf(HasSubstr("unstable"), HasSubstr("nothing written")));
  EXPECT_FALSE(fs::exists(directory_ / "move.yaml"));
  EXPECT_EQ(excite({"--set", "plant.drive.torque_limit_Nm=[30, 6]", "--reach", "0.3"}).code, 0);
  const Result again = excite({});
  EXPECT_EQ(again.code, 2);
  EXPECT_THAT(again.errors, HasSubstr("move.yaml: exists already"));
  // The run stays within the motion's limits.
  const Result run = tachless(
      {"run", directory_ / "move.yaml", "--in-process", "--quiet", "--out", directory_ / "move"});
  EXPECT_EQ(run.code, 0) << run.errors;
  const auto summary = base::parse_json(contents(directory_ / "move/summary.json"));
  EXPECT_EQ(summary["saturated_ticks"], nlohmann::json({0, 0}));
  EXPECT_EQ(summary["beyond_limit_ticks"], nlohmann::json({0, 0}));
}

TEST_F(IdentifyVerb, RefusesALogThatDoesNotShowTheParameters) {
  const std::string log = usual_log();
  expect_refusal({run("held", {"--set", "reference={hold: {position_rad: [0, 0]}}"})},
                 "too little motion");
  expect_refusal({run("short", {"--set", "loop.duration_s=1"})}, "at least 2 s are needed");
  expect_refusal({run("weak", {"--set", "plant.drive.torque_limit_Nm=[60, 20]"})},
                 "a torque was at its limit in");
  expect_refusal({log, run("loaded", {"--set", "robot.gravity_m_per_s2=1.6"})},
                 "is of another robot than");
  const std::string flexible = directory_ / "flexible";
  tachless({"run", TACHLESS_SOURCE_DIR "/scenarios/practical_flexible.yaml", "--in-process",
            "--quiet", "--any-outcome", "--out", flexible, "--set", "loop.duration_s=0.1"});
  expect_refusal({flexible}, "flexible joints");
}

TEST_F(IdentifyVerb, CommissionTellsWhatAnArmDoes) {
  const auto commission = [&](Words more) {
    Words words = {"commission",
                   TACHLESS_SOURCE_DIR "/scenarios/practical_rigid.yaml",
                   "--quiet",
                   "--set",
                   "plant.mechanics=native",
                   "--set",
                   "plant.drive.torque_limit_Nm=[400, 100]"};
    words.insert(words.end(), more.begin(), more.end());
    return tachless(words);
  };
  const Words safe = {"--set", "plant.initial.position_rad=[0.25, 0.2]", "--set",
                      "robot.joints={rigid: {rotor_inertia_kgm2: [0.5, 0.1]}}"};
  Words words = safe;
  words.insert(words.end(), {"--set", "plant.encoder.latency_ticks=2", "--json", "--write",
                             directory_ / "known.yaml"});
  const Result result = commission(words);
  ASSERT_EQ(result.code, 0) << result.errors;
  const auto found = base::parse_json(result.output);
  EXPECT_EQ(found["adds_gravity"], nlohmann::json(false));
  EXPECT_EQ(found["delay_ticks"], nlohmann::json(3));
  EXPECT_EQ(found["unsent_torque"], nlohmann::json("held"));
  EXPECT_EQ(found["misfits"].size(), 0U);
  EXPECT_THAT(contents(directory_ / "known.yaml"), HasSubstr("latency_ticks: 2"));
  EXPECT_THAT(commission(words).errors, HasSubstr("known.yaml: exists already"));

  words.emplace_back("--overwrite");
  EXPECT_EQ(commission(words).code, 0);
}

TEST_F(IdentifyVerb, WhatIsWrittenIntoAnotherFolderFindsItsFiles) {
  fs::create_directories(directory_ / "a/b");
  const std::string motion = directory_ / "motion.csv", written = directory_ / "a/b/f.yaml";
  std::ofstream(motion) << "0, 0.25, 0.2\n1, 0.3, 0.1\n2, 0.25, 0.2\n";
  const Words safe = {"--set", "plant.mechanics=native",
                      "--set", "plant.drive.torque_limit_Nm=[400, 100]",
                      "--set", "plant.initial.position_rad=[0.25, 0.2]"};
  for (const char* verb : {"commission", "excite", "design"}) {
    Words words = {verb,      TACHLESS_SOURCE_DIR "/scenarios/practical_rigid.yaml",
                   "--quiet", "--write",
                   written,   "--force",
                   "--set",   "controller.urdf=robots/two_link.urdf",
                   "--set",   "reference={file: " + motion + "}"};
    words.insert(words.end(), safe.begin(), safe.end());
    const Result result = tachless(words);
    EXPECT_EQ(result.code, 0) << verb << ": " << result.errors;
    const Result certified = tachless({"certify", written, "--quiet"});
    EXPECT_EQ(certified.code, 0) << verb << ": " << certified.errors;
  }
  EXPECT_THAT(contents(written), HasSubstr("path: ../../motion.csv"));
}

TEST_F(IdentifyVerb, SaysWhatIsNotIdentifiableAndWritesNothing) {
  // Only one joint moves.
  const std::string log = run(
      "one",
      {"--set", "reference={multi_sine: {terms: [{amplitude_rad: [0.5, 0], frequency_hz: 0.1}]}}"});
  const Result result =
      tachless({"identify", log, "--quiet", "--write", directory_ / "refused.yaml"});
  EXPECT_EQ(result.code, 1);
  EXPECT_THAT(result.output, HasSubstr("not identifiable, the joint moves by"));
  EXPECT_THAT(result.errors, HasSubstr("nothing written"));
  EXPECT_FALSE(fs::exists(directory_ / "refused.yaml"));
}

}  // namespace
}  // namespace tachless::verb_test
