#include "bench/whole_run.h"

#include <algorithm>
#include <chrono>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <stdexcept>

void play(const std::string& scenario, const std::vector<std::string>& options,
          const TemporaryDirectory& directory) {
  std::vector<std::unique_ptr<Program>> programs;
  for (const std::string role : {"logger", "controller", "reference", "plant"}) {
    std::vector<std::string> arguments{scenario, "--stats", directory / role};
    arguments.insert(arguments.end(), options.begin(), options.end());
    if (role == "logger") arguments.insert(arguments.end(), {"--out-log", directory / "lcmlog"});
    programs.push_back(std::make_unique<Program>("tachless-" + role, arguments, directory.path()));
  }
  for (const auto& program : programs) {
    if (program->wait(std::chrono::seconds(600)) != 0) throw std::runtime_error(program->errors());
  }
}

double ticks_per_s(const TemporaryDirectory& directory) {
  const auto plant = nlohmann::json::parse(std::ifstream(directory / "plant"));
  return plant["ticks"].get<double>() / plant["wall_s"].get<double>();
}

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}
