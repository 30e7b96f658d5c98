// Runs over LCM's provider tcpq, with the server of Debian's liblcm-java.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <csignal>
#include <filesystem>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "bus/network_check.h"
#include "bus/tcpq_transport.h"
#include "logger/log_file.h"
#include "tests/support/private_network.h"
#include "tests/support/program.h"
#include "tests/system/four_programs.h"

using namespace tachless;

namespace {

namespace fs = std::filesystem;
using system_test::scenarios;
using ::testing::AllOf;
using ::testing::HasSubstr;

using Words = std::vector<std::string>;

class Tcpq : public ::testing::Test {
 protected:
  void start_server() {
    server_ = std::make_unique<Program>(
        "java", Words{"-cp", "/usr/share/java/lcm.jar", "lcm.lcm.TCPService", "7700"},
        directory_.path());
    while (bus::check_network(bus::parse_lcm_url(url))) {
      ASSERT_TRUE(server_->running()) << server_->errors();
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
  }
  int run(const std::string& out, const Words& more) {
    Words words = {"run",        scenarios + "paper_rigid.yaml",
                   "--duration", "0.02",
                   "--run-id",   "7",
                   "--out",      directory_ / out};
    words.insert(words.end(), more.begin(), more.end());
    Program program("tachless", words, directory_.path());
    const int code = program.wait();
    errors_ = program.errors();
    return code;
  }
  [[nodiscard]] std::string log(const std::string& out) const {
    return contents(directory_ / (out + "/lcmlog"));
  }

  static constexpr const char* url = "tcpq://127.0.0.1:7700";
  TemporaryDirectory directory_;
  std::unique_ptr<Program> server_;
  std::string errors_;
};

TEST_F(Tcpq, LeavesTheLogOfUdpAndIsHeardByStockTools) {
  start_server();
  ASSERT_EQ(run("udp", {}), 0) << errors_;
  Program logger("lcm-logger", {std::string("--lcm-url=") + url, directory_ / "stock"},
                 directory_.path());
  logger.wait_for("connecting");
  ASSERT_EQ(run("tcp", {"--lcm-url", url}), 0) << errors_;
  EXPECT_TRUE(log("udp") == log("tcp"));
  logger.signal(SIGINT);
  logger.wait();
  logger::LogReader stock(directory_ / "stock");
  int commands = 0;
  while (const auto event = stock.next()) commands += event->channel == "ARM_COMMAND" ? 1 : 0;
  EXPECT_GE(commands, 400);
}

TEST_F(Tcpq, LeavesTheSameLogUnderAKey) {
  start_server();
  ASSERT_EQ(run("udp", {}), 0) << errors_;
  std::ofstream(directory_ / "key") << std::string(32, 'k');
  fs::permissions(directory_ / "key", fs::perms::owner_read);
  ASSERT_EQ(run("under_key", {"--lcm-url", url, "--key-file", directory_ / "key"}), 0) << errors_;
  EXPECT_TRUE(log("udp") == log("under_key"));
}

TEST_F(Tcpq, EndsTheRunWhenTheServerIsGone) {
  start_server();
  Program program(
      "tachless",
      {"run", scenarios + "paper_rigid.yaml", "--lcm-url", url, "--out", directory_ / "out"},
      directory_.path());
  std::error_code absent;
  while (fs::file_size(directory_ / "out/lcmlog", absent) < 50'000 || absent) {
    ASSERT_TRUE(program.running()) << program.errors();
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  server_->signal(SIGKILL);
  EXPECT_EQ(program.wait(), 3);
  EXPECT_THAT(program.errors(), HasSubstr("the connection to the LCM server is gone"));
  EXPECT_TRUE(fs::exists(directory_ / "out/summary.json"));
  EXPECT_TRUE(fs::exists(directory_ / "out/report.html"));
}

TEST_F(Tcpq, SaysHowToStartAServerThatIsNotThere) {
  EXPECT_EQ(run("none", {"--lcm-url", url}), 2);
  EXPECT_THAT(errors_, AllOf(HasSubstr("tcpq://127.0.0.1:7700: no LCM server: Connection refused"),
                             HasSubstr("lcm.lcm.TCPService 7700")));
  EXPECT_EQ(run("none", {"--lcm-url", url, "--isolate"}), 2);
  EXPECT_THAT(errors_, HasSubstr("cannot be reached from a private network"));
}

// A channel that is longer than LCM's, and a message longer than a datagram, as any client may
// send.
TEST_F(Tcpq, PassesOverWhatIsTooLong) {
  start_server();
  bus::TcpqTransport watcher(bus::parse_lcm_url(url)), sender(bus::parse_lcm_url(url));
  watcher.subscribe_all();
  const std::string text = "sound";
  const auto payload = std::as_bytes(std::span(text));
  std::optional<bus::Datagram> heard;
  while (!heard) {
    sender.publish("A_CHANNEL", payload);
    heard = watcher.receive(loop::Clock::now() + std::chrono::milliseconds(50));
  }
  sender.publish(std::string(64, 'C'), payload);
  sender.publish("LAST", payload);
  const auto until = loop::Clock::now() + std::chrono::seconds(5);
  do {
    heard = watcher.receive(until);
    ASSERT_TRUE(heard);
    EXPECT_LE(heard->channel.size(), 63U);
  } while (heard->channel != "LAST");
  EXPECT_EQ(watcher.statistics().malformed, 1U);
}

TEST_F(Tcpq, PassesOverOwnMessagesAndNoOthers) {
  start_server();
  bus::TcpqTransport one(bus::parse_lcm_url(url)), other(bus::parse_lcm_url(url));
  one.subscribe("A_CHANNEL");
  other.subscribe("A_CHANNEL");
  const std::string own = "own", foreign = "foreign";
  const auto bytes = [](const std::string& text) { return std::as_bytes(std::span(text)); };
  // The server may take a subscription after a message of another connection: until one is heard.
  std::optional<bus::Datagram> heard;
  while (!heard) {
    one.publish("A_CHANNEL", bytes(own));
    heard = other.receive(loop::Clock::now() + std::chrono::milliseconds(50));
  }
  EXPECT_EQ(heard->payload.size(), own.size());
  other.publish("A_CHANNEL", bytes(foreign));
  // The same bytes as its own, from another: one more than it has sent.
  other.publish("A_CHANNEL", bytes(own));
  const auto until = loop::Clock::now() + std::chrono::seconds(5);
  std::vector<std::size_t> sizes;
  while (sizes.size() < 2) {
    const auto message = one.receive(until);
    ASSERT_TRUE(message);
    sizes.push_back(message->payload.size());
  }
  EXPECT_EQ(sizes, (std::vector<std::size_t>{foreign.size(), own.size()}));
  EXPECT_GE(one.statistics().own, 1U);
}

}  // namespace
