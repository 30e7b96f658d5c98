#include "certify/drive_prediction.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "base/parallel.h"
#include "base/text.h"
#include "linear/scenario_loop.h"
#include "scenario/drive_loop.h"

namespace tachless::certify {
namespace {

struct AtPosture {
  linear::DriveMargins margins;
  int host_ticks = 0;
};

}  // namespace

DrivePrediction predict_drives(const scenario::Scenario& scenario,
                               const linear::LawAnswers& answers) {
  const scenario::DriveLoopSpec drive = scenario::drive_loop(scenario).value();
  const linear::ScenarioLoop loop(scenario, answers);
  const auto rests = loop.rest_points(drive_postures);
  const auto all = base::parallel_map(rests.size(), [&](std::size_t i) {
    const linear::SampledLoop at = loop.at(rests[i]);
    const linear::SplitLoop split{linear::without_drive_loop(at.plant), drive,
                                  at.law(scenario.loop.period_s), scenario.loop.period_s, at.delay};
    return AtPosture{linear::drive_margins(split), linear::host_delay_margin(split)};
  });
  DrivePrediction result{all.front().margins, 0, 0, false, {}};
  int host_ticks = all.front().host_ticks;
  for (const AtPosture& at : all) {
    result.margins.gain = std::min(result.margins.gain, at.margins.gain);
    result.margins.delay_ticks = std::min(result.margins.delay_ticks, at.margins.delay_ticks);
    result.margins.modulus = std::min(result.margins.modulus, at.margins.modulus);
    host_ticks = std::min(host_ticks, at.host_ticks);
  }
  result.delay_s = result.margins.delay_ticks * drive.period_s;
  result.host_delay_s = std::max(0, host_ticks) * drive.period_s;
  constexpr double rounding = 1e-9;
  result.host_delay_ends =
      result.host_delay_s < (1 - rounding) * linear::most_host_ticks * scenario.loop.period_s;
  result.count_Nm =
      linear::drive_count_torque(drive, scenario::drive_count(scenario, drive, *scenario.model));
  return result;
}

std::string margins_text(const DrivePrediction& drives) {
  const linear::DriveMargins& margins = drives.margins;
  return fmt::format(
      "modulus {:.2g}; gain {}, delay {}{}", margins.modulus,
      std::isinf(margins.gain) ? "without limit" : fmt::format("{:.3g}", margins.gain),
      margins.delay_ticks == linear::most_drive_ticks ? "at least " : "",
      base::period_text(drives.delay_s));
}

std::string host_delay_text(const DrivePrediction& drives) {
  return fmt::format("the host's torques may come {}{} later",
                     drives.host_delay_ends ? "" : "at least ",
                     base::period_text(drives.host_delay_s));
}

}  // namespace tachless::certify
