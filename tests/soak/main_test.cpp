// The soak as `./tachless soak` runs it.

#include <gmock/gmock.h>

#include <csignal>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <set>
#include <string>

#include "tests/support/program.h"

namespace {

using ::testing::HasSubstr;

TEST(Soak, GoesThroughAllFaultsAndFindsThatAllIsKept) {
  const TemporaryDirectory directory;
  const std::string out = directory / "out";
  Program soak("tachless-soak",
               {"--rounds", "10", "--seed", "10", "--ticks", "8000", "--json", "--out", out},
               directory.path());
  EXPECT_EQ(soak.wait(std::chrono::seconds(500)), 0) << soak.errors();
  const auto json = nlohmann::json::parse(soak.output());
  EXPECT_EQ(json["rounds"], 10);
  EXPECT_EQ(json["held"], 10);
  for (const auto& [fault, tally] : json["faults"].items()) EXPECT_EQ(tally["rounds"], 1) << fault;
  EXPECT_GT(json["faults"]["hostile"]["hostile_datagrams"], 10'000);
  EXPECT_GT(json["faults"]["loss"]["resends"], 100);
  EXPECT_EQ(json["memory_kib"].size(), 4U);
  EXPECT_EQ(json, nlohmann::json::parse(contents(out + "/soak.json")));
  std::set<std::string> files;
  for (const auto& entry : std::filesystem::directory_iterator(out)) {
    files.insert(entry.path().filename());
  }
  EXPECT_EQ(files, std::set<std::string>{"soak.json"}) << "only what did not hold is kept";
}

TEST(Soak, EndsWithItsReportOnCtrlC) {
  const TemporaryDirectory directory;
  Program soak("tachless-soak", {"--minutes", "100", "--out", directory / "out"}, directory.path());
  soak.wait_for("round 1, seed 1");
  soak.signal(SIGINT);
  EXPECT_EQ(soak.wait(std::chrono::seconds(30)), 130) << soak.errors();
  EXPECT_THAT(soak.output(), HasSubstr("0 rounds in 0.0 min from seed 1, 0 held"));
}

TEST(Soak, PlaysRoundsOfTheFaultCampaignWithTheRealPrograms) {
  const TemporaryDirectory directory;
  // Among them: a key, the wall clock, a Ctrl-C, acknowledgements from the logger's address.
  Program soak("tachless-soak",
               {"--attacks", "--rounds", "5", "--seed", "205", "--out", directory / "out"},
               directory.path());
  EXPECT_EQ(soak.wait(std::chrono::seconds(150)), 0) << soak.errors();
  EXPECT_THAT(soak.output(), HasSubstr("5 rounds in "));
  EXPECT_THAT(soak.output(), HasSubstr(", 0 broke an invariant\n"));
  EXPECT_TRUE(std::filesystem::is_empty(directory / "out")) << "only what broke one is kept";
}

TEST(Soak, WantsToKnowHowLong) {
  const TemporaryDirectory directory;
  Program soak("tachless-soak", {}, directory.path());
  EXPECT_EQ(soak.wait(), 2);
  EXPECT_THAT(soak.errors(), HasSubstr("--minutes 30"));
}

}  // namespace
