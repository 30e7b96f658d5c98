// What a key on the bus costs: the four programs on a scenario, by turns without and with one, in a
// network of their own; and a message tagged and checked alone.
//   key_bench [SCENARIO [PAIRS]]

#include <sys/stat.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <fstream>
#include <string>
#include <vector>

#include "bench/whole_run.h"
#include "bus/authenticated.h"
#include "process/this_process.h"
#include "tests/support/in_memory.h"
#include "tests/support/program.h"

using namespace tachless;

namespace {

double ticks_per_s(const std::string& scenario, bool with_key) {
  const TemporaryDirectory directory;
  const std::string key = directory / "key";
  std::ofstream(key) << std::string(64, '5');
  chmod(key.c_str(), 0600);
  play(scenario,
       with_key ? std::vector<std::string>{"--key-file", key} : std::vector<std::string>{},
       directory);
  return ticks_per_s(directory);
}

/// From `publish` to `receive`, in one thread over memory [us].
double us_per_message(bus::Transport& sender, bus::Transport& receiver) {
  constexpr int messages = 200'000;
  constexpr const char* channel = "ARM_POSITION";
  receiver.subscribe(channel);
  const std::vector<std::byte> payload(52);  // a position_measurement_t of two joints
  const auto begin = std::chrono::steady_clock::now();
  for (int i = 0; i < messages; ++i) {
    sender.publish(channel, payload);
    if (!receiver.receive(loop::Clock::time_point::min())) throw std::runtime_error("not heard");
  }
  const std::chrono::duration<double, std::micro> taken = std::chrono::steady_clock::now() - begin;
  return taken.count() / messages;
}

void measure_messages() {
  std::vector<double> plain, keyed;
  for (int i = 0; i < 9; ++i) {
    bus::InMemoryNetwork network;
    const auto a = network.connect("a"), b = network.connect("b");
    plain.push_back(us_per_message(*a, *b));
    bus::Authenticated tagging(*a, {}), checking(*b, {});
    tagging.enter(7, {1, 2, 3, 4});
    checking.enter(7, {1, 2, 3, 4});
    keyed.push_back(us_per_message(tagging, checking));
  }
  std::printf("a message tagged and checked: %.2f us (of which the memory bus %.2f us)\n",
              median(keyed), median(plain));
}

}  // namespace

int main(int argc, char** argv) try {
  const std::string scenario =
      argc > 1 ? argv[1] : TACHLESS_SOURCE_DIR "/scenarios/paper_rigid.yaml";
  const int pairs = argc > 2 ? std::atoi(argv[2]) : 9;
  measure_messages();
  process::enter_private_network();
  std::vector<double> without, with, ratios;
  for (int i = 0; i < pairs; ++i) {
    without.push_back(ticks_per_s(scenario, false));
    with.push_back(ticks_per_s(scenario, true));
    ratios.push_back(with.back() / without.back());
    std::printf("%10.0f %10.0f ticks/s  ratio %.3f\n", without.back(), with.back(), ratios.back());
    std::fflush(stdout);
  }
  std::printf("median: %.0f ticks/s without, %.0f with; ratio of a pair %.3f (%.3f to %.3f)\n",
              median(without), median(with), median(ratios),
              *std::min_element(ratios.begin(), ratios.end()),
              *std::max_element(ratios.begin(), ratios.end()));
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
