// These tests use LCM's own tools on our bus and our logs, in a network of their own. lcm-logger
// records a run, and lcm-logplayer plays one back.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <csignal>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/json_text.h"
#include "bus/udp_transport.h"
#include "logger/log_file.h"
#include "tests/support/private_network.h"
#include "tests/support/program.h"

namespace tachless::stock_tools_test {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

namespace fs = std::filesystem;
using Json = nlohmann::json;
using Bytes = std::vector<std::byte>;

const std::string scenario = TACHLESS_SOURCE_DIR "/scenarios/practical_rigid.yaml";

/// Returns the stdout of a tachless command that succeeds.
std::string tachless(const std::vector<std::string>& words, const TemporaryDirectory& directory) {
  return output_of("tachless", words, directory);
}

/// Records a lockstep run of some hundred ticks with run id 7.
std::string record(const TemporaryDirectory& directory) {
  tachless({"run", scenario, "--duration", "0.3", "--run-id", "7", "--quiet", "--out",
            directory / "out"},
           directory);
  return directory / "out/lcmlog";
}

/// Returns the messages by channel and tick, as they were on the bus.
std::map<std::string, std::map<std::int64_t, Bytes>> messages_of(const std::string& log) {
  std::map<std::string, std::map<std::int64_t, Bytes>> all;
  logger::LogReader reader(log);
  while (const auto event = reader.next()) {
    if (event->data.size() < 32) continue;
    std::uint64_t tick = 0;  // after fingerprint, utime and run
    for (std::size_t i = 24; i < 32; ++i) {
      tick = tick << 8 | std::to_integer<std::uint64_t>(event->data[i]);
    }
    all[std::string(event->channel)].emplace(static_cast<std::int64_t>(tick),
                                             Bytes(event->data.begin(), event->data.end()));
  }
  return all;
}

TEST(StockTools, InfoExportAndReportReadWhatLcmLoggerRecordedOfARealtimeRun) {
  const TemporaryDirectory directory;
  const std::string stock = directory / "stock.log";
  Program recorder("lcm-logger",
                   {"--lcm-url=udpm://239.255.76.67:7667?ttl=0", "--flush-interval=10", stock},
                   directory.path());
  bus::UdpTransport probe;
  wait_until("lcm-logger to record", [&] {
    probe.publish("PROBE", std::as_bytes(std::span("are you there?")));
    std::error_code error;
    const auto size = fs::file_size(stock, error);
    return !error && size > 0;
  });
  // A busy machine may miss commands. The test is not about these.
  tachless({"run", scenario, "--mode", "realtime", "--duration", "1", "--run-id", "8", "--quiet",
            "--set", "loop.max_missed=1000", "--set", "loop.max_missed_share=1", "--out",
            directory / "out"},
           directory);
  recorder.signal(SIGINT);
  EXPECT_EQ(recorder.wait(), 0) << recorder.errors();

  const Json info = base::parse_json(tachless({"info", "--json", stock}, directory));
  ASSERT_TRUE(info["run"].is_object()) << base::json_text(info, 1);
  EXPECT_EQ(info["run"]["id"], 8);
  EXPECT_EQ(info["run"]["mode"], "realtime");
  EXPECT_EQ(info["run"]["scenario"], "practical_rigid");
  EXPECT_EQ(info["run"]["num_ticks"], 1000);
  EXPECT_TRUE(info["run"]["undecodable"].empty());
  const auto ticks = info["run"]["ticks"].get<std::size_t>();
  EXPECT_GT(ticks, 0U);

  // Both logs have the same messages of a tick, byte for byte.
  const auto by_stock = messages_of(stock);
  const auto by_us = messages_of(directory / "out/lcmlog");
  for (const std::string channel : {"ARM_POSITION", "ARM_REFERENCE", "ARM_COMMAND", "ARM_TRUTH"}) {
    std::size_t compared = 0;
    for (const auto& [tick, bytes] : by_stock.at(channel)) {
      const auto ours = by_us.at(channel).find(tick);
      if (ours == by_us.at(channel).end()) continue;
      EXPECT_EQ(bytes, ours->second) << channel << " " << tick;
      ++compared;
    }
    EXPECT_GT(compared, 0U) << channel;
  }

  tachless({"export", stock, "-o", directory / "run.csv"}, directory);
  const std::string table = contents(directory / "run.csv");
  EXPECT_EQ(std::count(table.begin(), table.end(), '\n'), static_cast<std::ptrdiff_t>(ticks + 1));
  EXPECT_THAT(table, HasSubstr("tick,t_s,q_shoulder_rad,q_elbow_rad,"));
  tachless({"report", stock, "-o", directory / "report.html"}, directory);
  EXPECT_THAT(contents(directory / "report.html"),
              AllOf(HasSubstr("practical_rigid"), HasSubstr("</svg>"), HasSubstr("</html>")));
}

TEST(StockTools, WatchHearsEveryMessageThatLcmLogplayerPlaysBack) {
  const TemporaryDirectory directory;
  const std::string log = record(directory);
  Program watch("tachless", {"watch", "--json"}, directory.path());
  // It prints its messages once a second. It listens when its first line appears.
  wait_until("watch to listen",
             [&] { return watch.output().find('\n') != std::string::npos || !watch.running(); });
  output_of("lcm-logplayer", {log}, directory);
  std::map<std::string, std::size_t> expected;
  for (const auto& [channel, messages] : messages_of(log)) expected[channel] = messages.size();
  // The player has ended. Its messages may still be in the socket of `watch`, which reads no more
  // once it is interrupted.
  Json heard;
  std::map<std::string, std::size_t> counted;
  wait_until("watch to print the last message", [&] {
    const std::string output = watch.output();
    const std::size_t end = output.rfind('\n');
    const std::size_t last = end == 0 ? std::string::npos : output.rfind('\n', end - 1);
    heard = base::parse_json(output.substr(last + 1, end - last));
    counted.clear();
    for (const auto& entry : heard["channels"]) counted[entry["channel"]] = entry["messages"];
    return counted == expected || heard["lost_here"] != 0 || !watch.running();
  });
  watch.signal(SIGINT);
  ASSERT_EQ(watch.wait(), 0) << watch.errors();

  EXPECT_EQ(heard["undecodable"], 0);
  ASSERT_EQ(heard["lost_here"], 0);
  for (const auto& entry : heard["channels"]) {
    EXPECT_EQ(entry["not_ours"], 0);
    EXPECT_EQ(entry["tick_gaps"].is_null() ? 0 : entry["tick_gaps"].get<int>(), 0)
        << entry["channel"];
  }
  EXPECT_EQ(counted, expected);
  EXPECT_EQ(expected.at("ARM_COMMAND"), 300U);
}

}  // namespace
}  // namespace tachless::stock_tools_test
