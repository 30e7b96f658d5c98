// What a loop of four processes costs without this project: the six datagrams of a tick, of the
// same sizes and with the same plant, between four processes that check, repeat and record nothing.
//   loop_peers SCENARIO [--set KEY=VALUE] [--ticks N] [--cpus P,R,C,L] [--nap US]
// One socket each with a kernel filter on the first byte, blocking recv. --cpus: where plant,
// reference, controller and logger run (default: the scheduler's choice). --nap: the logger empties
// its socket, then sleeps. In a private network; prints ticks per second.

#include <arpa/inet.h>
#include <linux/filter.h>
#include <net/if.h>
#include <sched.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "bus/truth/truth_wire.h"
#include "bus/wire.h"
#include "experiment/scenario.h"
#include "loop/measurements.h"
#include "plant/plant_model.h"
#include "process/this_process.h"
#include "robot/dynamics.h"

using namespace tachless;

namespace {

using Clock = std::chrono::steady_clock;

enum Kind : std::uint8_t { tick, measurement, reference, command, signals, truth, num_kinds };
constexpr std::array<const char*, num_kinds> channel_names = {
    "ARM_TICK",    "ARM_POSITION",         "ARM_REFERENCE",
    "ARM_COMMAND", "ARM_CONTROLLER_STATE", "ARM_TRUTH"};
enum Role { plant_role, reference_role, controller_role, logger_role, num_roles };
constexpr std::array<std::array<bool, num_kinds>, num_roles> wanted = {{
    {false, false, false, true, false, false},
    {true, false, false, false, false, false},
    {false, true, true, false, false, false},
    {true, true, true, true, true, true},
}};
constexpr int warm_up = 500;
constexpr std::int64_t reply_s = 5;

/// Begins every datagram; the rest, up to the size of ours, is numbers or nothing.
struct Message {
  std::uint8_t kind = 0;
  std::int64_t tick = 0;
  std::array<double, 500> values{};
};

struct Options {
  std::string scenario;
  std::vector<std::string> overrides;
  std::int64_t ticks = 20'000;
  std::vector<int> cpus;
  int nap_us = 0;
};

/// Sizes of our messages as datagrams, channel name and LCM's header included [bytes].
std::array<std::size_t, num_kinds> sizes_of(const experiment::Scenario& scenario) {
  const auto layout =
      loop::layout(scenario.num_joints, scenario.robot.flexible.has_value(), /*num_signals=*/2);
  std::array<std::size_t, num_kinds> sizes = {
      bus::Codec<loop::Tick>(layout).longest(),
      bus::Codec<loop::PositionMeasurement>(layout).longest(),
      bus::Codec<loop::ReferencePoint>(layout).longest(),
      bus::Codec<loop::TorqueCommand>(layout).longest(),
      bus::Codec<loop::LawSignals>(layout).longest(),
      bus::Codec<loop::truth::PlantTruth>(layout).longest()};
  for (std::size_t i = 0; i < num_kinds; ++i) {
    sizes[i] = std::clamp(sizes[i] + 8 + std::strlen(channel_names[i]) + 1,
                          offsetof(Message, values) + 8 * std::size_t(scenario.num_joints),
                          sizeof(Message));
  }
  return sizes;
}

/// The multicast group of the loop, from which one role receives what it wants.
class Bus {
 public:
  explicit Bus(Role role) : in_(open()), out_(open()) {
    std::uint32_t mask = 0;
    for (std::uint32_t kind = 0; kind < num_kinds; ++kind)
      mask |= wanted[role][kind] ? 1U << kind : 0;
    // Accept when bit (first byte) of the mask is set; the UDP header is 8 bytes.
    std::array<sock_filter, 7> program = {
        {BPF_STMT(BPF_LD | BPF_B | BPF_ABS, 8), BPF_STMT(BPF_MISC | BPF_TAX, 0),
         BPF_STMT(BPF_LD | BPF_IMM, mask), BPF_STMT(BPF_ALU | BPF_RSH | BPF_X, 0),
         BPF_JUMP(BPF_JMP | BPF_JSET | BPF_K, 1, 0, 1), BPF_STMT(BPF_RET | BPF_K, 0xffff),
         BPF_STMT(BPF_RET | BPF_K, 0)}};
    const sock_fprog handle{program.size(), program.data()};
    const int on = 1;
    const int bytes = 4 << 20;
    const timeval patience{reply_s, 0};
    set(SOL_SOCKET, SO_ATTACH_FILTER, handle);
    set(SOL_SOCKET, SO_REUSEADDR, on);
    set(SOL_SOCKET, SO_RCVBUF, bytes);
    set(SOL_SOCKET, SO_RCVTIMEO, patience);
    sockaddr_in group{};
    group.sin_family = AF_INET;
    group.sin_port = htons(7667);
    inet_pton(AF_INET, "239.255.76.67", &group.sin_addr);
    ip_mreq membership{group.sin_addr, {htonl(INADDR_ANY)}};
    const auto* address = reinterpret_cast<const sockaddr*>(&group);
    set(IPPROTO_IP, IP_ADD_MEMBERSHIP, membership);
    if (::bind(in_, address, sizeof group) != 0 || ::connect(out_, address, sizeof group) != 0) {
      throw std::runtime_error(std::strerror(errno));
    }
  }
  void send(const Message& message, std::size_t size) {
    if (::send(out_, &message, size, 0) < 0) throw std::runtime_error(std::strerror(errno));
  }
  /// @return false after `reply_s` of silence, or, without `wait`, when there is nothing
  bool receive(Message& message, bool wait) {
    return ::recv(in_, &message, sizeof message, wait ? 0 : MSG_DONTWAIT) > 0;
  }

 private:
  static int open() { return ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0); }
  template <class Value>
  void set(int level, int option, const Value& value) const {
    if (::setsockopt(in_, level, option, &value, sizeof value) != 0) {
      throw std::runtime_error(std::strerror(errno));
    }
  }
  int in_, out_;  // end with the process
};

class Loop {
 public:
  Loop(const Options& options, const experiment::Scenario& scenario)
      : options_(options), scenario_(scenario), sizes_(sizes_of(scenario)) {}

  void run(Role role, int ready, int go) {
    if (!options_.cpus.empty()) {
      cpu_set_t set;
      CPU_ZERO(&set);
      CPU_SET(static_cast<std::size_t>(options_.cpus.at(role)), &set);
      if (sched_setaffinity(0, sizeof set, &set) != 0) throw std::runtime_error("no such CPU");
    }
    bus_.emplace(role);
    char byte = 0;
    if (::write(ready, &byte, 1) != 1) throw std::runtime_error("pipe");
    if (role == plant_role) {
      if (::read(go, &byte, 1) != 1) throw std::runtime_error("pipe");
      plant();
    } else if (role == reference_role) {
      while (receive(tick)) send(reference, message_.tick + 1);
    } else if (role == controller_role) {
      controller();
    } else {
      log();
    }
  }

 private:
  bool receive(Kind kind) {
    do {
      if (!bus_->receive(message_, true)) return false;
    } while (message_.kind != kind);
    return true;
  }
  void send(Kind kind, std::int64_t k) {
    message_.kind = kind;
    message_.tick = k;
    bus_->send(message_, sizes_[kind]);
  }

  void controller() {
    for (std::int64_t k = 0, known = 0;; ++k) {
      bool measured = false;
      while (!measured || known < k) {
        if (!bus_->receive(message_, true)) return;
        if (message_.kind == measurement) measured = true;
        if (message_.kind == reference) known = message_.tick;
      }
      const double sign = k % 2 == 0 ? 1 : -1;
      for (int i = 0; i < scenario_.num_joints; ++i) message_.values[std::size_t(i)] = sign;
      send(command, k);
      send(signals, k);
    }
  }

  void plant() {
    const robot::Model model = plant::plant_model(scenario_);
    plant::Arm arm = plant::make_arm(scenario_, model);
    // Jumps of 20 rad/s^2 at every joint.
    const robot::Vector jump = 10 * robot::mass_matrix(model, arm.state().q).diagonal();
    robot::Vector tau(scenario_.num_joints);
    auto begun = Clock::now();
    for (std::int64_t k = 0; k < options_.ticks + warm_up; ++k) {
      if (k == warm_up) begun = Clock::now();
      send(tick, k);
      send(measurement, k);
      if (!receive(command)) throw std::runtime_error("no command: a datagram was lost");
      for (int i = 0; i < scenario_.num_joints; ++i)
        tau[i] = jump[i] * message_.values[std::size_t(i)];
      send(truth, k);
      arm.advance(tau, static_cast<double>(k + 1) * scenario_.loop.period_s);
    }
    const std::chrono::duration<double> wall = Clock::now() - begun;
    std::printf("%.1f\n", static_cast<double>(options_.ticks) / wall.count());
    std::fflush(stdout);
  }

  void log() {
    for (std::int64_t heard = 0;; ++heard) {
      if (bus_->receive(message_, options_.nap_us == 0)) continue;
      ::usleep(static_cast<useconds_t>(options_.nap_us));
    }
  }

  const Options& options_;
  const experiment::Scenario& scenario_;
  std::array<std::size_t, num_kinds> sizes_;
  std::optional<Bus> bus_;
  Message message_;
};

Options options_of(int argc, char** argv) {
  const std::vector<std::string> words(argv + 1, argv + argc);
  if (words.size() % 2 == 0) throw std::invalid_argument("see loop_peers.cpp");
  Options options;
  options.scenario = words[0];
  for (std::size_t i = 1; i < words.size(); i += 2) {
    const std::string& value = words[i + 1];
    if (words[i] == "--set") options.overrides.push_back(value);
    if (words[i] == "--ticks") options.ticks = std::stoll(value);
    if (words[i] == "--nap") options.nap_us = std::stoi(value);
    if (words[i] == "--cpus") {
      std::istringstream list(value);
      for (std::string cpu; std::getline(list, cpu, ',');) options.cpus.push_back(std::stoi(cpu));
    }
  }
  return options;
}

}  // namespace

int main(int argc, char** argv) try {
  const Options options = options_of(argc, argv);
  process::enter_private_network();
  const auto scenario = experiment::load_scenario(options.scenario, options.overrides);
  std::array<int, 2> ready{}, go{};
  if (::pipe(ready.data()) != 0 || ::pipe(go.data()) != 0) return 1;
  std::array<pid_t, num_roles> children{};
  for (int role = 0; role < num_roles; ++role) {
    children[std::size_t(role)] = ::fork();
    if (children[std::size_t(role)] != 0) continue;
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    try {
      Loop(options, scenario).run(static_cast<Role>(role), ready[1], go[0]);
    } catch (const std::exception& error) {
      std::fprintf(stderr, "loop_peers: %s\n", error.what());
      ::_exit(1);
    }
    ::_exit(0);
  }
  ::close(ready[1]);
  std::array<char, num_roles> bytes{};
  int others = 0;
  while (others < num_roles && ::read(ready[0], bytes.data(), 1) == 1) ++others;
  if (others == num_roles && ::write(go[1], bytes.data(), 1) != 1) return 1;
  ::close(go[1]);
  int status = 1;
  ::waitpid(children[plant_role], &status, 0);
  for (int role = reference_role; role < num_roles; ++role) {
    ::kill(children[std::size_t(role)], SIGKILL);
    ::waitpid(children[std::size_t(role)], nullptr, 0);
  }
  return status == 0 ? 0 : 1;
} catch (const std::exception& error) {
  std::fprintf(stderr, "loop_peers: %s\n", error.what());
  return 1;
}
