// Measures the cost of a loop of four processes without this project. The processes exchange the
// six datagrams of a tick, of the same sizes and with the same plant. They check, repeat and record
// nothing.
//   loop_peers SCENARIO MECHANICS TICKS [CPU CPU]
// Each process has one socket with a kernel filter on the first byte and blocks in recv. The first
// CPU runs plant, reference and controller, the second the logger; without them the scheduler
// decides. A logger on a CPU of its own empties its socket and sleeps for 1 ms. The network is
// private. Prints ticks per second.

#include <arpa/inet.h>
#include <linux/filter.h>
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
#include <stdexcept>
#include <string>
#include <vector>

#include "base/this_process.h"
#include "messages/measurements.h"
#include "messages/truth/truth_wire.h"
#include "messages/wire.h"
#include "plant/plant_model.h"
#include "robot/dynamics.h"
#include "scenario/scenario.h"

using namespace tachless;

namespace {

using Clock = std::chrono::steady_clock;

enum Kind : std::uint8_t { tick, measurement, reference, command, signals, truth, num_kinds };
constexpr std::array<std::size_t, num_kinds> channel_lengths = {8, 12, 13, 11, 20, 9};  // ARM_TICK…
enum Role { plant_role, reference_role, controller_role, logger_role, num_roles };
/// The kinds that each role receives, one bit per kind.
constexpr std::array<std::uint32_t, num_roles> wanted = {1U << command, 1U << tick,
                                                         1U << measurement | 1U << reference, 0x3f};
constexpr int warm_up = 500;

/// The beginning of every datagram. The rest, up to the size of this project's datagrams, is
/// numbers or padding.
struct Message {
  std::uint8_t kind = 0;
  std::int64_t tick = 0;
  std::array<double, 500> values{};
};

/// Returns the sizes of this project's messages as datagrams, with channel name and LCM's header
/// [bytes].
std::array<std::size_t, num_kinds> sizes_of(const scenario::Scenario& scenario) {
  const auto layout =
      messages::layout(scenario.num_joints, scenario.robot.flexible.has_value(), /*num_signals=*/2);
  std::array<std::size_t, num_kinds> sizes = {
      messages::Codec<messages::Tick>(layout).longest(),
      messages::Codec<messages::PositionMeasurement>(layout).longest(),
      messages::Codec<messages::ReferencePoint>(layout).longest(),
      messages::Codec<messages::TorqueCommand>(layout).longest(),
      messages::Codec<messages::LawSignals>(layout).longest(),
      messages::Codec<messages::truth::PlantTruth>(layout).longest()};
  for (std::size_t i = 0; i < num_kinds; ++i) {
    sizes[i] = std::clamp(sizes[i] + 8 + channel_lengths[i] + 1,
                          offsetof(Message, values) + 8 * std::size_t(scenario.num_joints),
                          sizeof(Message));
  }
  return sizes;
}

/// One role of the loop: a socket that receives the role's kinds from the multicast group, and a
/// socket that sends to it.
class Peer {
 public:
  Peer(Role role, const scenario::Scenario& scenario)
      : scenario_(scenario), sizes_(sizes_of(scenario)) {
    // Accepts a datagram if bit (first byte) of the mask is set. The UDP header is 8 bytes.
    std::array<sock_filter, 7> program = {
        {BPF_STMT(BPF_LD | BPF_B | BPF_ABS, 8), BPF_STMT(BPF_MISC | BPF_TAX, 0),
         BPF_STMT(BPF_LD | BPF_IMM, wanted[role]), BPF_STMT(BPF_ALU | BPF_RSH | BPF_X, 0),
         BPF_JUMP(BPF_JMP | BPF_JSET | BPF_K, 1, 0, 1), BPF_STMT(BPF_RET | BPF_K, 0xffff),
         BPF_STMT(BPF_RET | BPF_K, 0)}};
    set(SOL_SOCKET, SO_ATTACH_FILTER, sock_fprog{program.size(), program.data()});
    set(SOL_SOCKET, SO_REUSEADDR, int{1});
    set(SOL_SOCKET, SO_RCVBUF, int{4 << 20});
    set(SOL_SOCKET, SO_RCVTIMEO, timeval{5, 0});
    sockaddr_in group{};
    group.sin_family = AF_INET;
    group.sin_port = htons(7667);
    inet_pton(AF_INET, "239.255.76.67", &group.sin_addr);
    set(IPPROTO_IP, IP_ADD_MEMBERSHIP, ip_mreq{group.sin_addr, {htonl(INADDR_ANY)}});
    const auto* address = reinterpret_cast<const sockaddr*>(&group);
    require(::bind(in_, address, sizeof group) == 0 && ::connect(out_, address, sizeof group) == 0);
  }

  /// Steps the plant with a torque jump of about 20 rad/s^2 at every joint.
  /// @return ticks per second
  double plant(std::int64_t ticks) {
    const robot::Model model = plant::plant_model(scenario_);
    plant::Arm arm =
        plant::make_arm(scenario_.plant, scenario_.robot.flexible, model,
                        plant::initial_state(scenario_.plant, scenario_.robot.flexible, model));
    const Vector jump = 10 * robot::mass_matrix(model, arm.state().q).diagonal();
    auto begun = Clock::now();
    for (std::int64_t k = 0; k < ticks + warm_up; ++k) {
      if (k == warm_up) begun = Clock::now();
      send(tick, k);
      send(measurement, k);
      require(receive());
      const Vector tau = jump * message_.values[0];
      send(truth, k);
      arm.advance(tau, static_cast<double>(k + 1) * scenario_.loop.period_s);
    }
    return static_cast<double>(ticks) / std::chrono::duration<double>(Clock::now() - begun).count();
  }
  void give_references() {
    while (receive()) send(reference, message_.tick + 1);
  }
  void control() {
    for (std::int64_t k = 0, known = 0;; ++k) {
      for (bool measured = false; !measured || known < k;) {
        if (!receive()) return;
        measured = measured || message_.kind == measurement;
        if (message_.kind == reference) known = message_.tick;
      }
      message_.values[0] = k % 2 == 0 ? 1 : -1;
      send(command, k);
      send(signals, k);
    }
  }
  void log(bool naps) {
    for (;;) {
      if (!receive(naps ? MSG_DONTWAIT : 0)) ::usleep(1000);
    }
  }

 private:
  static void require(bool done) {
    if (!done) throw std::runtime_error(std::strerror(errno));
  }
  template <class Value>
  void set(int level, int option, const Value& value) const {
    require(::setsockopt(in_, level, option, &value, sizeof value) == 0);
  }
  void send(Kind kind, std::int64_t k) {
    message_.kind = kind;
    message_.tick = k;
    require(::send(out_, &message_, sizes_[kind], 0) > 0);
  }
  bool receive(int flags = 0) { return ::recv(in_, &message_, sizeof message_, flags) > 0; }

  const scenario::Scenario& scenario_;
  std::array<std::size_t, num_kinds> sizes_;
  int in_ = ::socket(AF_INET, SOCK_DGRAM, 0), out_ = ::socket(AF_INET, SOCK_DGRAM, 0);
  Message message_;
};

void run_on(const std::string& cpu) {
  if (!base::execute_on({std::stoi(cpu)})) throw std::runtime_error("no such CPU");
}

}  // namespace

int main(int argc, char** argv) try {
  const std::vector<std::string> words(argv + 1, argv + argc);
  if (words.size() != 3 && words.size() != 5) throw std::invalid_argument("see loop_peers.cpp");
  base::enter_private_network();
  const auto scenario = scenario::load_scenario(words[0], {"plant.mechanics=" + words[1]});
  std::array<int, 2> ready{};
  if (::pipe(ready.data()) != 0) return 1;
  for (const Role role : {reference_role, controller_role, logger_role}) {
    if (::fork() != 0) continue;
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (words.size() > 3) run_on(words[role == logger_role ? 4 : 3]);
    Peer peer(role, scenario);
    if (::write(ready[1], "", 1) != 1) return 1;
    ::close(ready[1]);
    if (role == reference_role) peer.give_references();
    if (role == controller_role) peer.control();
    peer.log(words.size() > 3 && words[3] != words[4]);
  }
  ::close(ready[1]);  // so the reads below end if a peer does not start
  if (words.size() > 3) run_on(words[3]);
  Peer peer(plant_role, scenario);
  char byte = 0;
  for (int others = 1; others < num_roles; ++others) {
    if (::read(ready[0], &byte, 1) != 1) return 1;
  }
  std::printf("%.1f\n", peer.plant(std::stoll(words[2])));
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "loop_peers: %s\n", error.what());
  return 1;
}
