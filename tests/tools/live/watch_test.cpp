// `tachless watch` beside a run, in a network of their own.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <pty.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstdint>
#include <map>
#include <nlohmann/json.hpp>
#include <span>
#include <stdexcept>
#include <string>
#include <thread>

#include "base/json_text.h"
#include "bus/udp_transport.h"
#include "messages/wire.h"
#include "tests/support/private_network.h"
#include "tests/support/program.h"
#include "tests/tools/cli/endless_run.h"

using namespace tachless;

namespace {

using std::chrono::milliseconds;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::StartsWith;

std::map<std::string, nlohmann::json> channels_of(const nlohmann::json& heard) {
  std::map<std::string, nlohmann::json> channels;
  for (const auto& entry : heard["channels"]) channels[entry["channel"]] = entry;
  return channels;
}

TEST(Watch, DecodesEveryChannelOfARunAndLeavesItAlone) {
  const TemporaryDirectory directory;
  EndlessRun run(directory);
  wait_until("the run to get going", [&] { return run.under_way(); });
  Program watch("tachless", {"watch", "--once", "--json", "--seconds", "1"}, directory.path());
  ASSERT_EQ(watch.wait(), 0) << watch.errors();
  EXPECT_THAT(watch.errors(), IsEmpty());
  EXPECT_EQ(run.interrupt(), 130);
  const auto summary = base::parse_json(contents(directory / "out/summary.json"));
  EXPECT_EQ(summary["fault"], "interrupted");
  EXPECT_EQ(summary["log"]["gaps"], 0);

  const auto heard = base::parse_json(watch.output());
  EXPECT_EQ(heard["undecodable"], 0);
  EXPECT_EQ(heard["malformed"], 0);
  EXPECT_GE(heard["seconds"], 1);
  EXPECT_EQ(heard["senders"].size(), 4U);
  const auto channels = channels_of(heard);
  const std::map<std::string, std::string> expected = {
      {"ARM_TICK", "tachless.tick_t"},
      {"ARM_LINK_STATE", "tachless.link_state_measurement_t"},
      {"ARM_REFERENCE", "tachless.reference_t"},
      {"ARM_COMMAND", "tachless.torque_command_t"},
      {"ARM_CONTROLLER_STATE", "tachless.controller_state_t"},
      {"ARM_TRUTH", "tachless_truth.plant_truth_t"},
      {"ARM_LOG_ACK", "tachless.log_ack_t"},
      {"ARM_PARTICIPANT", "tachless.participant_t"}};
  std::map<std::string, std::string> types;
  for (const auto& [name, entry] : channels) types[name] = entry["type"];
  types.erase("ARM_RUN_INFO");  // once a second: perhaps not within this one
  EXPECT_EQ(types, expected);
  for (const auto& [name, entry] : channels) EXPECT_EQ(entry["undecodable"], 0) << name;
  EXPECT_EQ(channels.at("ARM_TRUTH")["newest"]["motor_velocity"].size(), 2U);
  EXPECT_EQ(channels.at("ARM_CONTROLLER_STATE")["newest"]["value[3]"].size(), 2U);
  EXPECT_GT(channels.at("ARM_TICK")["rate_hz"].get<double>(), 0);
}

TEST(Watch, CountsWhatASenderLeftOutAndWhatCannotBeDecoded) {
  const TemporaryDirectory directory;
  // The first of these messages may come before the program listens, hence again and again.
  Program watch("tachless", {"watch", "--once", "--json", "--seconds", "3"}, directory.path());
  bus::UdpTransport transport;
  messages::Codec<messages::Tick> codec(messages::Layout{});
  for (std::int64_t k = 0; watch.running(); k += 2) {
    transport.publish("ARM_TICK", codec.encode({k, 1, k}, {}));
    transport.publish("ARM_TICK", std::as_bytes(std::span("garbage")));
    std::this_thread::sleep_for(milliseconds(2));
  }
  ASSERT_EQ(watch.wait(), 0) << watch.errors();
  const auto heard = base::parse_json(watch.output());
  const auto tick = channels_of(heard).at("ARM_TICK");
  const auto messages = tick["messages"].get<int>();
  EXPECT_GT(messages, 0);
  EXPECT_EQ(heard["senders"][0]["missing"], 0);
  // Every other message is garbage, every other tick is left out.
  EXPECT_NEAR(tick["undecodable"].get<int>(), messages / 2, 1);
  EXPECT_NEAR(tick["tick_gaps"].get<int>(), messages / 2, 1);
}

TEST(Watch, RefusesABusThatIsNone) {
  const TemporaryDirectory directory;
  Program watch("tachless", {"watch", "--once", "--lcm-url", "udp://nowhere"}, directory.path());
  EXPECT_EQ(watch.wait(), 2);
  EXPECT_THAT(watch.errors(), HasSubstr("LCM URL 'udp://nowhere'"));
}

TEST(Watch, RefusesAPortThatAnotherPageHas) {
  const TemporaryDirectory directory, other;
  Program first("tachless", {"watch", "--web", "--port", "0"}, directory.path());
  std::string url;
  wait_until("the page", [&] {
    url = first.output();
    return url.ends_with('\n');
  });
  ASSERT_THAT(url, StartsWith("http://127.0.0.1:"));
  const std::string port = std::to_string(std::stoi(url.substr(url.rfind("1:") + 2)));
  Program second("tachless", {"watch", "--web", "--port", port, "--seconds", "1"}, other.path());
  EXPECT_EQ(second.wait(), 2);
  EXPECT_THAT(second.errors(), HasSubstr("--port " + port + ": in use"));
  first.signal(SIGINT);
  EXPECT_EQ(first.wait(), 0);
  Program third("tachless", {"watch", "--web", "--port", port, "--seconds", "0.1"}, other.path());
  EXPECT_EQ(third.wait(), 0) << third.errors();  // at once: the port is free again
}

/// A program on a terminal of 100 columns and 20 rows.
class OnTerminal {
 public:
  OnTerminal() {
    const winsize size{20, 100, 0, 0};
    pid_ = forkpty(&terminal_, nullptr, nullptr, &size);
    if (pid_ == 0) {
      execl(TACHLESS_BINARY_DIR "/bin/tachless", "tachless", "watch", nullptr);
      _exit(127);
    }
    if (pid_ < 0) throw std::runtime_error("forkpty");
  }
  ~OnTerminal() {
    if (pid_ > 0) {
      kill(pid_, SIGKILL);
      waitpid(pid_, nullptr, 0);
    }
    close(terminal_);
  }
  OnTerminal(const OnTerminal&) = delete;
  OnTerminal& operator=(const OnTerminal&) = delete;

  /// Everything written until `text` has been.
  std::string read_until(const std::string& text) {
    pollfd ready{terminal_, POLLIN, 0};
    while (written_.find(text) == std::string::npos) {
      char buffer[4096];
      if (poll(&ready, 1, 60'000) != 1) throw std::runtime_error("no '" + text + "': " + written_);
      const ssize_t got = read(terminal_, buffer, sizeof buffer);
      if (got <= 0) throw std::runtime_error("it ended: " + written_);
      written_.append(buffer, static_cast<std::size_t>(got));
    }
    return written_;
  }

  int interrupt() {
    kill(pid_, SIGINT);
    read_until("\033[?25h");
    int status = 0;
    waitpid(pid_, &status, 0);
    pid_ = -1;
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }

 private:
  int terminal_ = -1;
  pid_t pid_ = -1;
  std::string written_;
};

TEST(Watch, RedrawsInPlaceOnATerminalAndGivesTheCursorBack) {
  OnTerminal watch;
  // An empty bus: one line of counts, a line between, the table's head, a line between.
  const std::string screen = watch.read_until("\033[4A\r");
  EXPECT_THAT(screen, AllOf(StartsWith("udpm://"), HasSubstr("\033[?25l"), HasSubstr("channel")));
  EXPECT_THAT(screen, AllOf(HasSubstr("\033[?7l"), HasSubstr("\033[?7h"))) << "it cuts long lines";
  EXPECT_EQ(watch.interrupt(), 0);
}

}  // namespace
