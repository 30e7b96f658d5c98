// `tachless gains` on a bus with a key, beside an outsider that repeats an earlier session.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <memory>
#include <span>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "bus/udp_transport.h"
#include "logger/run_log.h"
#include "tests/support/private_network.h"
#include "tests/system/four_programs.h"

namespace tachless::recorded_gains_test {
namespace {

using system_test::FourPrograms;
using system_test::roles;
using ::testing::HasSubstr;

/// Calls `turn` again and again in a thread of its own.
template <class F>
class Repeated {
 public:
  explicit Repeated(F turn)
      : thread_([this, turn = std::move(turn)]() mutable {
          while (!over_) turn();
        }) {}
  ~Repeated() {
    over_ = true;
    thread_.join();
  }

 private:
  std::atomic<bool> over_ = false;
  std::thread thread_;
};

class ARecordedSession : public testing::Test {
 protected:
  struct Recorded {
    std::string channel, payload;
  };

  void SetUp() override {
    key_ = (directory_.path() / "robot.key").string();
    std::ofstream(key_) << std::string(64, 'a');
    std::filesystem::permissions(key_, std::filesystem::perms::owner_read);
  }

  [[nodiscard]] std::vector<std::string> settings(const std::string& period_s) const {
    return {"--set",      "loop.duration_s=999",
            "--set",      "loop.mode=realtime",
            "--set",      "loop.max_missed=1000000",
            "--set",      "loop.max_missed_share=1",
            "--set",      "controller.gains_may_change=true",
            "--set",      "loop.period_s=" + period_s,
            "--key-file", key_};
  }
  static void end(FourPrograms& run) {
    run["plant"].signal(SIGINT);
    for (const char* role : roles) run[role].wait();
  }

  /// Records a session at 1 kHz until it has all kinds of messages, then ends it.
  void record() {
    FourPrograms run{"practical_rigid.yaml"};
    run.settings = settings("0.001");
    bus::UdpTransport transport;
    transport.subscribe_all();
    std::atomic<int> run_infos = 0;
    {
      const Repeated recorder([&] {
        const auto datagram = transport.receive(base::Clock::now() + std::chrono::milliseconds(20));
        if (!datagram) return;
        if (datagram->channel == "ARM_RUN_INFO") ++run_infos;
        recorded_.push_back({std::string(datagram->channel),
                             std::string(reinterpret_cast<const char*>(datagram->payload.data()),
                                         datagram->payload.size())});
      });
      run.start_all();
      wait_until("the log grows", [&] { return run.log_size() > 500'000; });
      wait_until("RUN_INFO has come twice", [&] { return run_infos >= 2; });
    }
    end(run);
  }

  /// Repeats the recorded messages whose channel `chosen` accepts, 1,000 a second.
  template <class F>
  [[nodiscard]] auto outsider(F chosen) const {
    return [this, chosen, transport = std::make_shared<bus::UdpTransport>(),
            at = std::size_t{0}]() mutable {
      const Recorded& each = recorded_[at++ % recorded_.size()];
      if (!chosen(each.channel)) return;
      transport->publish(each.channel, std::as_bytes(std::span(each.payload)));
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    };
  }

  int change(const std::string& gain) {
    Program program("tachless", {"gains", "arm", gain, "--key-file", key_}, directory_.path());
    const int code = program.wait();
    said_ = program.output() + program.errors();
    return code;
  }

  static std::size_t changes_in(const std::string& path) {
    logger::RunLog log = logger::RunLog::open(path);
    messages::TickRecord record;
    while (log.next(record)) continue;
    return log.summary().gains.size();
  }

  TemporaryDirectory directory_;
  std::string key_, said_;
  std::vector<Recorded> recorded_;
};

TEST_F(ARecordedSession, ConfirmsNoChangeWhereNobodyRuns) {
  record();
  const Repeated ghost(outsider([](const std::string&) { return true; }));
  EXPECT_EQ(change("kp=[300, 100]"), 3) << said_;
}

TEST_F(ARecordedSession, DoesNotDecideWhichLoopIsAnalysed) {
  record();
  FourPrograms run{"practical_rigid.yaml"};
  run.settings = settings("0.003");
  run.start_all();
  wait_until("the log grows", [&] { return run.log_size() > 200'000; });
  {
    const Repeated outsider_of_it(outsider([](const std::string& channel) {
      return channel == "ARM_RUN_INFO" || channel == "ARM_PARTICIPANT";
    }));
    // Stable at 1 kHz, unstable at 3 ms.
    EXPECT_NE(change("kp=[90000, 5400]"), 0) << said_;
  }
  EXPECT_EQ(change("kp=[90000, 5400]"), 2) << said_;
  EXPECT_THAT(said_, HasSubstr("unstable"));
  EXPECT_EQ(change("kp=[300, 100]"), 0) << said_;
  end(run);
  EXPECT_EQ(changes_in(run.log_path()), 1U);
}

}  // namespace
}  // namespace tachless::recorded_gains_test
