// Round trips between two processes over loopback, in a private network namespace: plain UDP,
// liblcm and the project's own transport, the latter two over multicast, alone on the bus and with
// a third process publishing on a channel that neither has subscribed to.
//
//   bus_bench [ROUND_TRIPS [CPU CPU]]     (20000; where the scheduler likes)

#include <arpa/inet.h>
#include <sched.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/time.h>
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
#include "process/file_descriptor.h"
#include "process/this_process.h"

using namespace tachless;

namespace {

using loop::Clock;
using std::chrono::microseconds;
using std::chrono::seconds;

constexpr const char* url = "udpm://239.255.76.67:7667?ttl=0";
constexpr std::size_t payload_size = 68;  // a position_measurement_t of four joints
using Payload = std::array<std::byte, payload_size>;

/// One side of a ping-pong: sends on one channel, receives on another.
class Side {
 public:
  virtual ~Side() = default;
  virtual void send(const Payload& payload) = 0;
  virtual bool receive() = 0;  ///< false after a second of silence
};

class OwnSide final : public Side {
 public:
  OwnSide(std::string out, const std::string& in) : out_(std::move(out)), transport_(url) {
    transport_.subscribe(in);
  }
  void send(const Payload& payload) override { transport_.publish(out_, payload); }
  bool receive() override { return transport_.receive(Clock::now() + seconds(1)).has_value(); }

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
  void send(const Payload& payload) override {
    lcm_.publish(out_, payload.data(), static_cast<unsigned>(payload.size()));
  }
  bool receive() override {
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

/// Datagrams from socket to socket and nothing else: what the kernel takes.
class RawSide final : public Side {
 public:
  RawSide(const std::string& out, const std::string& in) : fd_(::socket(AF_INET, SOCK_DGRAM, 0)) {
    const sockaddr_in own = address(in);
    to_ = address(out);
    const timeval patience{1, 0};
    if (::bind(fd_.get(), reinterpret_cast<const sockaddr*>(&own), sizeof own) != 0 ||
        ::setsockopt(fd_.get(), SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience) != 0) {
      throw std::runtime_error("no UDP socket");
    }
  }
  void send(const Payload& payload) override {
    ::sendto(fd_.get(), payload.data(), payload.size(), 0, reinterpret_cast<const sockaddr*>(&to_),
             sizeof to_);
  }
  bool receive() override {
    Payload payload;
    return ::recv(fd_.get(), payload.data(), payload.size(), 0) > 0;
  }

 private:
  static sockaddr_in address(const std::string& channel) {
    sockaddr_in result{};
    result.sin_family = AF_INET;
    result.sin_port = htons(channel == "PING" ? 7001 : 7002);
    result.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    return result;
  }
  process::FileDescriptor fd_;
  sockaddr_in to_{};
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

void run_on(int cpu) {
  cpu_set_t set;
  CPU_ZERO(&set);
  CPU_SET(static_cast<std::size_t>(cpu), &set);
  if (sched_setaffinity(0, sizeof set, &set) != 0) throw std::runtime_error("no such processor");
}

void ping_pong(const char* name, const MakeSide& make, bool chatter, int round_trips,
               const std::vector<int>& cpus) {
  std::array<int, 2> up{};
  if (::pipe(up.data()) != 0) throw std::runtime_error("no pipe");
  const pid_t echo = in_child([&] {
    if (!cpus.empty()) run_on(cpus[1]);
    const auto side = make("PONG", "PING");
    if (::write(up[1], "", 1) != 1) return;
    for (const Payload payload{};;) {
      if (side->receive()) side->send(payload);
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
  if (!cpus.empty()) run_on(cpus[0]);
  const auto side = make("PING", "PONG");
  std::array<char, 1> byte;
  if (::read(up[0], byte.data(), 1) != 1) throw std::runtime_error("the echo did not start");
  ::close(up[0]);
  ::close(up[1]);
  const Payload payload{};
  std::vector<double> round_trip_us;
  int lost = 0;
  for (int i = -round_trips / 10; i < round_trips; ++i) {  // the first tenth warms up
    const auto start = Clock::now();
    side->send(payload);
    if (!side->receive()) {
      ++lost;
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
  std::printf("%-32s p50 %6.1f us   p99 %6.1f us   p99.9 %7.1f us   lost %d\n", name, quantile(0.5),
              quantile(0.99), quantile(0.999), lost);
  std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv) {
  const int round_trips = argc > 1 ? std::atoi(argv[1]) : 20'000;
  std::vector<int> cpus;
  if (argc > 3) cpus = {std::atoi(argv[2]), std::atoi(argv[3])};
  process::enter_private_network();
  const MakeSide own = [](const auto& out, const auto& in) {
    return std::make_unique<OwnSide>(out, in);
  };
  const MakeSide liblcm = [](const auto& out, const auto& in) {
    return std::make_unique<LiblcmSide>(out, in);
  };
  const MakeSide raw = [](const auto& out, const auto& in) {
    return std::make_unique<RawSide>(out, in);
  };
  ping_pong("plain UDP", raw, false, round_trips, cpus);
  ping_pong("own transport", own, false, round_trips, cpus);
  ping_pong("liblcm", liblcm, false, round_trips, cpus);
  ping_pong("own transport, foreign traffic", own, true, round_trips, cpus);
  ping_pong("liblcm, foreign traffic", liblcm, true, round_trips, cpus);
}
