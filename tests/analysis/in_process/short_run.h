// A short run in one process, tick by tick.
#pragma once

#include <string>
#include <vector>

#include "controller/registry.h"
#include "in_process/in_process_loop.h"
#include "scenario/scenario.h"

namespace tachless::in_process {

/// Returns practical_rigid with 200 ticks, then with `overrides`.
inline scenario::Scenario practical(const std::vector<std::string>& overrides = {}) {
  std::vector<std::string> all = {"loop.duration_s=0.2"};
  all.insert(all.end(), overrides.begin(), overrides.end());
  return scenario::load_scenario(
      std::string(TACHLESS_SOURCE_DIR) + "/scenarios/practical_rigid.yaml", all);
}

/// Returns what each tick records, with the emulator's mechanics or with a simulator in their
/// place.
inline std::vector<TickRecord> records(const scenario::Scenario& scenario,
                                       plant::Simulator* simulator = nullptr) {
  std::vector<TickRecord> all;
  const auto keep = [&](const TickRecord& record) {
    all.push_back(record);
    return true;
  };
  if (simulator == nullptr) {
    run_in_process(scenario, keep);
  } else {
    run_in_process(scenario, controller::scenario_law(scenario), keep, *simulator);
  }
  return all;
}

}  // namespace tachless::in_process
