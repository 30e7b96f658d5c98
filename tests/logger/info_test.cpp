#include "logger/info.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <nlohmann/json.hpp>
#include <vector>

#include "tests/support/damaged_log.h"
#include "tests/support/recorded_run.h"
#include "tests/support/temporary_directory.h"

namespace tachless::logger {
namespace {

using testing::AllOf;
using testing::HasSubstr;

class Info : public testing::Test {
 protected:
  nlohmann::json info_of(const std::string& bytes) {
    write_file(path_, bytes);
    return read_info(path_);
  }

  TemporaryDirectory directory_;
  std::filesystem::path path_ = directory_.path() / "lcmlog";
};

TEST_F(Info, NeedsNoMoreMemoryForALongLog) {
  constexpr int megabytes = 100;
  {
    const auto run_path = directory_.path() / "run";
    write_file(run_path, short_flexible_run().bytes());
    LogReader run(run_path);
    LogWriter log(path_);
    while (const auto event = run.next()) log.append(event->utime, event->channel, event->data);
    const std::vector<std::byte> data(1 << 12);  // every page must be read
    for (int i = 0; i < 256 * megabytes; ++i) log.append(0, "CAMERA", data);
    log.close();
  }
  const auto most_kB = [] {
    rusage usage{};
    getrusage(RUSAGE_SELF, &usage);
    return usage.ru_maxrss;
  };
  const long before_kB = most_kB();
  const auto info = read_info(path_);
  EXPECT_FALSE(info["run"].is_null());
  EXPECT_EQ(info["channels"].back()["channel"], "CAMERA");
  // Limit for two blocks of 4 MB and the window of ticks. Without returned pages it would be 105
  // MB.
  EXPECT_LT(most_kB() - before_kB, 40'000);
}

TEST_F(Info, TellsRunAndChannelsOfOurLog) {
  const auto info = info_of(short_flexible_run().bytes());
  EXPECT_EQ(info["messages"], 1u + 6 * 40);
  ASSERT_EQ(info["channels"].size(), 7u);
  const auto& command = info["channels"][0];
  EXPECT_EQ(command["channel"], "ARM_COMMAND");
  EXPECT_EQ(command["type"], "tachless.torque_command_t");
  EXPECT_EQ(command["messages"], 40u);
  // 40 ticks of 10 us, stamped in whole microseconds, are exact.
  EXPECT_DOUBLE_EQ(command["rate_hz"].get<double>(), 1e5);
  EXPECT_EQ(command["longest_silence_us"], 10);
  std::map<std::string, std::string> types;
  for (const auto& channel : info["channels"]) types[channel["channel"]] = channel["type"];
  EXPECT_EQ(types["ARM_TICK"], "tachless.tick_t");
  EXPECT_EQ(types["ARM_LINK_STATE"], "tachless.link_state_measurement_t");
  EXPECT_EQ(types["ARM_REFERENCE"], "tachless.reference_t");
  EXPECT_EQ(types["ARM_CONTROLLER_STATE"], "tachless.controller_state_t");
  EXPECT_EQ(types["ARM_TRUTH"], "tachless_truth.plant_truth_t");
  EXPECT_EQ(types["ARM_RUN_INFO"], "tachless.run_info_t");
  ASSERT_FALSE(info["run"].is_null());
  EXPECT_EQ(info["run"]["scenario"], "paper_flexible");
  EXPECT_EQ(info["run"]["law"], "loria_ortega_flexible");
  EXPECT_EQ(info["run"]["flexible"], true);
  EXPECT_EQ(info["run"]["gaps"], 0u);
  EXPECT_EQ(info["damage"]["any"], false);
  EXPECT_THAT(to_text(info),
              AllOf(HasSubstr("paper_flexible"), HasSubstr("flexible)"), HasSubstr("40 of 40"),
                    HasSubstr("gaps      0"), HasSubstr("damage    none"),
                    HasSubstr("tachless_truth.plant_truth_t")));
}

TEST_F(Info, TellsGapsAndDamage) {
  auto run = short_rigid_run();
  std::erase_if(run.messages, [](const Recorded& message) {
    return message.channel == "ARM_COMMAND" && message.utime >= 250 && message.utime <= 350;
  });
  const auto bytes = run.bytes();
  const auto info = info_of("garbage" + bytes);
  ASSERT_FALSE(info["run"].is_null());
  EXPECT_THAT(to_text(info),
              AllOf(HasSubstr("ARM_COMMAND: 3 missing, ticks 5-7"), HasSubstr("byte 0: 7 bytes")));
  EXPECT_EQ(info["run"]["gaps"], 3);
  EXPECT_EQ(info["run"]["pieces"][3]["missing_ticks"][0], nlohmann::json({5, 7}));
  EXPECT_EQ(info["damage"]["bytes_skipped"], 7);
}

TEST_F(Info, TellsHowTheRunEnded) {
  auto run = short_rigid_run();
  auto info = info_of(run.bytes());
  EXPECT_EQ(info["run"]["end"], nlohmann::json({{"how", "planned"}, {"text", nullptr}}));
  EXPECT_THAT(to_text(info), HasSubstr("\nended     as planned\n"));
  run.messages.resize(1 + 6 * 20);
  info = info_of(run.bytes());
  EXPECT_EQ(info["run"]["end"]["how"], "unknown");
  EXPECT_THAT(to_text(info),
              HasSubstr("\nended     the log ends after 20 of 40 ticks and does not say why\n"));
  run.messages.push_back(fault_message(run, "encoder lost"));
  info = info_of(run.bytes());
  EXPECT_EQ(info["run"]["end"], nlohmann::json({{"how", "stopped"}, {"text", "encoder lost"}}));
  EXPECT_THAT(to_text(info), HasSubstr("\nended     encoder lost\n"));
}

TEST_F(Info, OfLogsThatWereAppendedGivesNoRateAndNamesTheOtherRun) {
  const auto info = info_of(short_rigid_run().bytes() + short_rigid_run(99).bytes());
  ASSERT_FALSE(info["run"].is_null());
  for (const auto& channel : info["channels"]) EXPECT_TRUE(channel["rate_hz"].is_null()) << channel;
  EXPECT_THAT(to_text(info), HasSubstr("of other runs: 99\n"));
}

TEST_F(Info, ReadsLogsThatAreNotOurs) {
  std::string bytes;
  for (int i = 0; i < 11; ++i) bytes += event_text(i, 1'000'000 + i * 20'000, "CAMERA", "data");
  const auto info = info_of(bytes);
  ASSERT_EQ(info["channels"].size(), 1u);
  EXPECT_TRUE(info["channels"][0]["type"].is_null());
  EXPECT_DOUBLE_EQ(info["channels"][0]["rate_hz"].get<double>(), 50);
  EXPECT_TRUE(info["run"].is_null());
  EXPECT_THAT(info["run_problem"], HasSubstr("no RUN_INFO"));
  EXPECT_THAT(to_text(info), AllOf(HasSubstr("CAMERA"), HasSubstr("not ours")));
}

TEST_F(Info, OfWhatIsNoLogSaysWhatItIs) {
  const auto refusal = [&](const std::string& text) -> std::string {
    try {
      (void)info_of(text);
    } catch (const base::Failure& failure) {
      return failure.what();
    }
    return "accepted";
  };
  EXPECT_THAT(refusal("<?xml version='1.0'?><robot name='a'/>"),
              HasSubstr("this is a robot description; type: tachless robot /"));
  EXPECT_THAT(refusal("name: a\nrobot:\n  urdf: b\ncontroller: {}\n"),
              HasSubstr("this is a scenario; type: tachless run /"));
  EXPECT_THAT(refusal(""), HasSubstr("the file is empty; name an LCM log"));
  const std::string log = event_text(0, 0, "ARM_RUN_INFO", "<robot name='a'/>");
  EXPECT_THAT(refusal(log.substr(0, log.size() - 1)), HasSubstr("ends in its first message"));
  EXPECT_THAT(refusal("\x01\xDA\xA1\xED<robot name='a'/>"), HasSubstr("byte order"));
  EXPECT_THAT(refusal("something else"), HasSubstr("not one message of an LCM log"));
}

TEST_F(Info, JsonOfWhateverTextsCanBeWritten) {
  auto run = short_rigid_run();
  run.messages.push_back(fault_message(run, "caf\xc3\xa9 \xff\xfe"));
  const auto info = info_of(run.bytes());
  EXPECT_NO_THROW(info.dump());
  ASSERT_EQ(info["run"]["faults"].size(), 1u);
  EXPECT_EQ(info["run"]["faults"][0]["text"], "caf\xc3\xa9 ??");
}

TEST_F(Info, BoundsTheNumberOfChannels) {
  std::string bytes;
  for (int i = 0; i < 1500; ++i) bytes += event_text(i, i, std::to_string(i), "");
  const auto info = info_of(bytes);
  EXPECT_EQ(info["channels"].size(), max_channels);
  EXPECT_EQ(info["messages_on_further_channels"], 500u);
}

}  // namespace
}  // namespace tachless::logger
