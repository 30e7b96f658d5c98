// Where a tick's time goes: the four programs on a scenario, several times, in a network of their
// own; medians over all ticks of what each process measured of itself.
//   loop_bench [SCENARIO [REPEATS]]

#include <algorithm>
#include <cstdio>
#include <exception>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "bench/whole_run.h"
#include "process/this_process.h"
#include "tests/support/program.h"

using namespace tachless;

namespace {

struct Figures {
  double ticks_per_s = 0, step_us = 0, round_trip_us = 0, law_us = 0, reference_us = 0, log_us = 0;
};

Figures measure(const std::string& scenario) {
  const TemporaryDirectory directory;
  play(scenario, {}, directory);
  const auto stats = [&](const std::string& role) {
    return nlohmann::json::parse(std::ifstream(directory / role));
  };
  const auto work = [&](const std::string& role) { return stats(role)["work_us"]["p50"]; };
  return {ticks_per_s(directory), work("plant"),     stats("plant")["round_trip_us"]["p50"],
          work("controller"),     work("reference"), work("logger")};
}

void print(const char* what, const std::vector<Figures>& runs, double Figures::*figure) {
  std::vector<double> values;
  for (const Figures& run : runs) values.push_back(run.*figure);
  std::sort(values.begin(), values.end());
  std::printf("%-34s %10.1f %10.1f %10.1f\n", what, values.front(), values[values.size() / 2],
              values.back());
}

}  // namespace

int main(int argc, char** argv) try {
  const std::string scenario =
      argc > 1 ? argv[1] : TACHLESS_SOURCE_DIR "/scenarios/paper_rigid.yaml";
  const int repeats = argc > 2 ? std::stoi(argv[2]) : 5;
  process::enter_private_network();
  std::vector<Figures> runs;
  for (int i = 0; i < repeats; ++i) {
    runs.push_back(measure(scenario));
    std::fprintf(stderr, "run %d of %d: %.0f ticks/s\n", i + 1, repeats, runs.back().ticks_per_s);
  }
  std::printf("%-34s %10s %10s %10s\n", "", "least", "median", "most");
  print("ticks per second", runs, &Figures::ticks_per_s);
  print("plant step [us]", runs, &Figures::step_us);
  print("round trip [us]: bus and law", runs, &Figures::round_trip_us);
  print("  of which the law [us]", runs, &Figures::law_us);
  print("reference, beside it [us]", runs, &Figures::reference_us);
  print("log, beside it [us]", runs, &Figures::log_us);
} catch (const std::exception& error) {
  std::fprintf(stderr, "loop_bench: %s\n", error.what());
  return 1;
}
