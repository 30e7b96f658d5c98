// What `tachless watch` costs a run: the four programs on a scenario, by turns without and with it,
// in a network of their own.
//   watch_bench [SCENARIO [PAIRS]]

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "bench/whole_run.h"
#include "process/this_process.h"
#include "tests/support/program.h"

using namespace tachless;

namespace {

double ticks_per_s(const std::string& scenario) {
  const TemporaryDirectory directory;
  play(scenario, {}, directory);
  return ticks_per_s(directory);
}

/// @param lost grows by what the watching program was too slow for
double ticks_per_s_watched(const std::string& scenario, double& lost) {
  const TemporaryDirectory directory;
  Program watch("tachless", {"watch", "--json"}, directory.path());
  const double rate = ticks_per_s(scenario);
  watch.signal(SIGINT);
  watch.wait();
  const std::string output = watch.output();
  const std::size_t end = output.rfind('\n');
  if (end == std::string::npos) throw std::runtime_error("watch said nothing: " + watch.errors());
  const std::size_t begin = output.rfind('\n', end - 1) + 1;  // npos + 1 is 0
  const auto heard = nlohmann::json::parse(output.substr(begin, end - begin));
  lost += heard["lost_here"].get<double>() /
          (heard["lost_here"].get<double>() + heard["messages"].get<double>());
  return rate;
}

}  // namespace

int main(int argc, char** argv) try {
  const std::string scenario =
      argc > 1 ? argv[1] : TACHLESS_SOURCE_DIR "/scenarios/paper_rigid.yaml";
  const int pairs = argc > 2 ? std::atoi(argv[2]) : 9;
  process::enter_private_network();
  std::vector<double> without, with, ratios;
  double lost = 0;
  for (int i = 0; i < pairs; ++i) {
    without.push_back(ticks_per_s(scenario));
    with.push_back(ticks_per_s_watched(scenario, lost));
    ratios.push_back(with.back() / without.back());
    std::printf("%10.0f %10.0f ticks/s  ratio %.3f\n", without.back(), with.back(), ratios.back());
    std::fflush(stdout);
  }
  std::printf("median: %.0f ticks/s without, %.0f with; ratio of a pair %.3f (%.3f to %.3f)\n",
              median(without), median(with), median(ratios),
              *std::min_element(ratios.begin(), ratios.end()),
              *std::max_element(ratios.begin(), ratios.end()));
  std::printf("not seen by watch: %.1f %%\n", 100 * lost / pairs);
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
