// Measures round trips between two processes over multicast on loopback in a private network
// namespace. The transports are liblcm and the project's own.
//
//   bus_bench ROUND_TRIPS CPU CPU

#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <lcm/lcm-cpp.hpp>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "base/this_process.h"
#include "bus/udp_transport.h"

using namespace tachless;

namespace {

using base::Clock;

constexpr const char* url = "udpm://239.255.76.67:7667?ttl=0";
using Payload = std::array<std::byte, 68>;  // a position_measurement_t of four joints

/// One side of a ping-pong. It sends on one channel and receives on another.
struct Side {
  std::function<void(const Payload& payload)> send;
  std::function<bool()> receive;  ///< false after a second of silence
};
using MakeSide = Side (*)(const std::string& out, const std::string& in);

Side own(const std::string& out, const std::string& in) {
  const auto transport = std::make_shared<bus::UdpTransport>(bus::parse_lcm_url(url));
  transport->subscribe(in);
  return {[=](const Payload& payload) { transport->publish(out, payload); },
          [=] { return transport->receive(Clock::now() + std::chrono::seconds(1)).has_value(); }};
}

Side liblcm(const std::string& out, const std::string& in) {
  const auto lcm = std::make_shared<lcm::LCM>(url);
  const auto count = std::make_shared<int>(0);
  lcm_subscribe(
      lcm->getUnderlyingLCM(), in.c_str(),
      [](const lcm_recv_buf_t*, const char*, void* received) { ++*static_cast<int*>(received); },
      count.get());
  return {[=](const Payload& payload) { lcm->publish(out, payload.data(), payload.size()); },
          [=] {
            const int before = *count;
            while (*count == before) {
              if (lcm->handleTimeout(1000) <= 0) return false;
            }
            return true;
          }};
}

void run_on(int cpu) {
  if (!base::execute_on({cpu})) throw std::runtime_error("no such processor");
}

void ping_pong(const char* name, MakeSide make, int round_trips, int cpu, int other_cpu) {
  std::array<int, 2> up{};
  if (::pipe(up.data()) != 0) throw std::runtime_error("no pipe");
  const pid_t echo = ::fork();
  if (echo == 0) {
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    run_on(other_cpu);
    const Side side = make("PONG", "PING");
    if (::write(up[1], "", 1) != 1) ::_exit(1);
    for (const Payload payload{};;) {
      if (side.receive()) side.send(payload);
    }
  }
  ::close(up[1]);  // so the read below ends if the echo does not start
  run_on(cpu);
  const Side side = make("PING", "PONG");
  char byte = 0;
  if (::read(up[0], &byte, 1) != 1) throw std::runtime_error("the echo did not start");
  std::vector<double> round_trip_us;
  for (int i = -round_trips / 10; i < round_trips; ++i) {  // the first tenth warms up
    const auto start = Clock::now();
    side.send({});
    if (!side.receive()) throw std::runtime_error("a datagram was lost");
    const std::chrono::duration<double, std::micro> taken = Clock::now() - start;
    if (i >= 0) round_trip_us.push_back(taken.count());
  }
  ::kill(echo, SIGKILL);
  ::waitpid(echo, nullptr, 0);
  std::sort(round_trip_us.begin(), round_trip_us.end());
  const auto quantile = [&](double q) {
    return round_trip_us.at(static_cast<std::size_t>(q * double(round_trip_us.size() - 1)));
  };
  std::printf("%-16s p50 %6.1f us   p99 %6.1f us\n", name, quantile(0.5), quantile(0.99));
  std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 4) return 2;
  base::enter_private_network();
  for (const auto& [name, make] :
       {std::pair<const char*, MakeSide>{"own transport", own}, {"liblcm", liblcm}}) {
    ping_pong(name, make, std::atoi(argv[1]), std::atoi(argv[2]), std::atoi(argv[3]));
  }
}
