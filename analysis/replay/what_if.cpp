#include "replay/replay.h"

#include <fmt/format.h>

#include <cerrno>
#include <cstring>
#include <fstream>
#include <system_error>
#include <utility>

#include "base/failure.h"
#include "base/file_text.h"
#include "base/text.h"
#include "controller/registry.h"
#include "logger/table.h"

namespace tachless::replay {
namespace {

constexpr std::string_view remedy = "name another place with --out";

/// Throws for a scenario key on which a controller's commands do not depend.
void require_of_controller(const std::vector<std::string>& overrides) {
  for (const std::string& setting : overrides) {
    const bool of_file = setting.starts_with("robot.urdf=") || setting.starts_with("robot.xacro");
    if (setting.starts_with("controller.") || setting.starts_with("loop.command_delay") ||
        (setting.starts_with("robot.") && !of_file)) {
      continue;
    }
    throw base::bad_usage(
        "--set {}: has no effect on a replay, which takes measurements, references and the URDF "
        "from the log; allowed: controller.…, robot.… but its URDF, loop.command_delay",
        setting);
  }
}

/// Returns the first line of the table.
std::string head(const robot::JointLabels& labels) {
  std::string line = "tick,t_s";
  const std::vector<std::string> names = {"tau", "tau_replayed"};
  const auto joints = logger::joints_in_columns(names, labels.name);
  for (const std::string& name : names) {
    for (std::size_t i = 0; i < joints.size(); ++i) {
      line += "," + base::csv_field(
                        logger::column_name(name, joints[i], labels.effort[i] == "N" ? "N" : "Nm"));
    }
  }
  return line + "\n";
}

}  // namespace

Comparison compare(logger::RunLog& log, const std::vector<std::string>& overrides,
                   const controller::MakeLaw& make_law, const std::filesystem::path& out,
                   const robot::JointLabels& labels) {
  require_of_controller(overrides);
  Comparison result{
      {},
      scenario::parse_scenario(log.info().scenario, log.info().robot_description,
                               fmt::format("{} (RUN_INFO)", log.path().string()), overrides),
      "",
      {}};
  const std::filesystem::path folder = out.empty() ? log.path().parent_path() : out;
  std::error_code error;
  result.csv = folder / "replay.csv";
  controller::ScenarioLaw law = make_law(result.scenario);  // throws before files are made
  if (result.scenario.controller.law == controller::external_law_name) {
    result.scenario.controller.announced = controller::law_info(*law).law;
  }
  const std::string was = log.scenario().controller.law_text();
  const std::string is = result.scenario.controller.law_text();
  result.title = fmt::format("{}: recorded under {}, replayed {}", log.scenario().name, was,
                             is == was ? "with other settings" : fmt::format("under {}", is));

  if (!folder.empty()) std::filesystem::create_directories(folder, error);
  base::UnfinishedFile file(result.csv, remedy);
  std::ofstream csv(file.name());
  csv << head(labels);
  if (!csv) file.refuse(std::strerror(errno));
  result.replay = replay(log, result.scenario, std::move(law),
                         [&](std::int64_t tick, const Vector& recorded, const Vector& replayed) {
                           const double t_s = static_cast<double>(tick) * log.info().period_s;
                           csv << fmt::format("{},{:.17g},{:.17g},{:.17g}\n", tick, t_s,
                                              fmt::join(recorded, ","), fmt::join(replayed, ","));
                         });
  csv.close();
  if (!csv) file.refuse(std::strerror(errno));
  file.finish();
  return result;
}

std::string comparison_text(const Comparison& comparison, const robot::JointLabels& labels,
                            double period_s) {
  const Replay& replay = comparison.replay;
  std::vector<std::vector<std::string>> rows = {
      {"joint", "replayed - recorded torque", "", "", "peak torque"},
      {"", "max", "at", "rms", "recorded", "replayed", ""}};
  for (std::size_t i = 0; i < replay.joints.size(); ++i) {
    const JointTorques& joint = replay.joints[i];
    rows.push_back({fmt::format("{} {}", i + 1, base::printable(labels.name[i])),
                    fmt::format("{:.5g}", joint.difference.peak()),
                    fmt::format("{:.4g} s", static_cast<double>(joint.peak_tick) * period_s),
                    fmt::format("{:.5g}", joint.difference.rms()),
                    fmt::format("{:.5g}", joint.recorded.peak()),
                    fmt::format("{:.5g}", joint.replayed.peak()), labels.effort[i]});
  }
  const std::string text =
      fmt::format("{}\n{} ticks, {} of them with another command\n\n{}", comparison.title,
                  replay.compared, replay.different, base::table(rows, "lrrrrrl"));
  return text + fmt::format("\n  {}\n", base::printable(comparison.csv.string()));
}

}  // namespace tachless::replay
