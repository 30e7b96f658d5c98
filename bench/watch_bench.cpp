// What `tachless watch` costs a run: the four programs on a scenario, by turns without and with it,
// in a network of their own.
//   watch_bench [SCENARIO [PAIRS]]

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "bus/isolate.h"
#include "tests/process/program.h"

namespace {

constexpr const char* roles[] = {"logger", "controller", "reference", "plant"};

double ticks_per_s(const std::string& scenario) {
  const Directory directory;
  std::vector<std::unique_ptr<Program>> programs;
  for (const std::string role : roles) {
    std::vector<std::string> arguments{scenario, "--stats", directory / role};
    if (role == "logger") arguments.insert(arguments.end(), {"--out-log", directory / "lcmlog"});
    programs.push_back(std::make_unique<Program>("tachless-" + role, arguments, directory.path()));
  }
  for (const auto& program : programs) {
    if (program->wait(std::chrono::seconds(600)) != 0) throw std::runtime_error(program->errors());
  }
  const auto plant = nlohmann::json::parse(std::ifstream(directory / "plant"));
  return plant["ticks"].get<double>() / plant["wall_s"].get<double>();
}

/// @param lost grows by what the watching program was too slow for
double ticks_per_s_watched(const std::string& scenario, double& lost) {
  const Directory directory;
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

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

}  // namespace

int main(int argc, char** argv) try {
  const std::string scenario =
      argc > 1 ? argv[1] : TACHLESS_SOURCE_DIR "/scenarios/paper_rigid.yaml";
  const int pairs = argc > 2 ? std::atoi(argv[2]) : 9;
  bus::enter_private_network();
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
