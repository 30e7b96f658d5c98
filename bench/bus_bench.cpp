// Round trips between two processes over UDP multicast on loopback, in a private network
// namespace: liblcm on both sides against the project's own transport, alone on the bus and with
// a third process publishing on a channel that neither has subscribed to.
//
//   bus_bench [ROUND_TRIPS]     (20000 by default)

#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <lcm/lcm-cpp.hpp>
#include <memory>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "bus/udp_transport.h"
#include "process/isolate.h"

using namespace tachless;

namespace {

using loop::Clock;
using std::chrono::microseconds;
using std::chrono::seconds;

constexpr const char* url = "udpm://239.255.76.67:7667?ttl=0";
constexpr std::size_t payload_size = 68;  // a position_measurement_t of four joints
using Payload = std::array<std::byte, payload_size>;

/// One side of a ping-pong: says something on one channel, waits for something on another.
class Side {
 public:
  virtual ~Side() = default;
  virtual void say(const Payload& payload) = 0;
  virtual bool hear() = 0;  ///< false after a second of silence
};

class OwnSide final : public Side {
 public:
  OwnSide(std::string out, const std::string& in) : out_(std::move(out)), transport_(url) {
    transport_.subscribe(in);
  }
  void say(const Payload& payload) override { transport_.publish(out_, payload); }
  bool hear() override { return transport_.receive(Clock::now() + seconds(1)).has_value(); }

 private:
  std::string out_;
  bus::UdpTransport transport_;
};

class LiblcmSide final : public Side {
 public:
  LiblcmSide(std::string out, const std::string& in) : out_(std::move(out)), lcm_(url) {
    if (!lcm_.good()) throw std::runtime_error("liblcm does not start");
    lcm_subscribe(
        lcm_.getUnderlyingLCM(), in.c_str(),
        [](const lcm_recv_buf_t*, const char*, void* heard) { ++*static_cast<int*>(heard); },
        &heard_);
  }
  void say(const Payload& payload) override {
    lcm_.publish(out_, payload.data(), static_cast<unsigned>(payload.size()));
  }
  bool hear() override {
    const int before = heard_;
    while (heard_ == before) {
      if (lcm_.handleTimeout(1000) <= 0) return false;
    }
    return true;
  }

 private:
  std::string out_;
  lcm::LCM lcm_;
  int heard_ = 0;
};

using MakeSide = std::function<std::unique_ptr<Side>(const std::string&, const std::string&)>;

pid_t in_child(const std::function<void()>& body) {
  const pid_t child = ::fork();
  if (child != 0) return child;
  body();
  ::_exit(0);
}

void end(pid_t child) {
  ::kill(child, SIGKILL);
  ::waitpid(child, nullptr, 0);
}

void ping_pong(const char* name, const MakeSide& make, bool chatter, int round_trips) {
  const pid_t echo = in_child([&] {
    const auto side = make("PONG", "PING");
    for (const Payload payload{};;) {
      if (side->hear()) side->say(payload);
    }
  });
  const pid_t talker = chatter ? in_child([] {
    bus::UdpTransport transport(url);
    const Payload payload{};
    for (;;) {
      transport.publish("CHATTER", payload);
      ::usleep(20);
    }
  })
                               : 0;
  const auto side = make("PING", "PONG");
  const Payload payload{};
  std::vector<double> round_trip_us;
  int silences = 0;
  for (int i = -round_trips / 10; i < round_trips; ++i) {  // the first tenth warms up
    const auto start = Clock::now();
    side->say(payload);
    if (!side->hear()) {
      ++silences;
      continue;
    }
    const std::chrono::duration<double, std::micro> taken = Clock::now() - start;
    if (i >= 0) round_trip_us.push_back(taken.count());
  }
  end(echo);
  if (talker != 0) end(talker);
  std::sort(round_trip_us.begin(), round_trip_us.end());
  const auto quantile = [&](double q) {
    return round_trip_us.at(static_cast<std::size_t>(q * double(round_trip_us.size() - 1)));
  };
  std::printf("%-32s p50 %6.1f us   p99 %6.1f us   p99.9 %7.1f us   silences %d\n", name,
              quantile(0.5), quantile(0.99), quantile(0.999), silences);
  std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv) {
  const int round_trips = argc > 1 ? std::atoi(argv[1]) : 20'000;
  process::enter_private_network();
  const MakeSide own = [](const auto& out, const auto& in) {
    return std::make_unique<OwnSide>(out, in);
  };
  const MakeSide liblcm = [](const auto& out, const auto& in) {
    return std::make_unique<LiblcmSide>(out, in);
  };
  ping_pong("liblcm", liblcm, false, round_trips);
  ping_pong("own transport", own, false, round_trips);
  ping_pong("liblcm, foreign traffic", liblcm, true, round_trips);
  ping_pong("own transport, foreign traffic", own, true, round_trips);
}
