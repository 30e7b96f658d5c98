#include "replay/what_if.h"

#include <fmt/format.h>

#include <cerrno>
#include <cstring>
#include <system_error>
#include <utility>

#include "controller/registry.h"
#include "diagnostics/failure.h"
#include "diagnostics/text.h"
#include "logger/table.h"
#include "report/chart.h"
#include "report/figure.h"
#include "report/gnuplot.h"
#include "report/summary.h"

namespace tachless::replay {
namespace {

constexpr std::string_view remedy = "name another place with --out";

/// Of the keys of a scenario, those that a controller's commands depend on.
void require_of_controller(const std::vector<std::string>& overrides) {
  for (const std::string& setting : overrides) {
    if (setting.starts_with("controller.") || setting.starts_with("robot.") ||
        setting.starts_with("loop.command_delay")) {
      continue;
    }
    throw diagnostics::bad_usage(
        "--set {}: has no effect on a replay, which takes measurements and references from the "
        "log; allowed: controller.…, robot.…, loop.command_delay",
        setting);
  }
}

}  // namespace

WhatIf::WhatIf(std::filesystem::path csv, double period_s, robot::JointLabels labels)
    : file_(std::move(csv), remedy),
      csv_(file_.name()),
      period_s_(period_s),
      labels_(std::move(labels)),
      joints_(labels_.name.size()) {
  csv_ << "tick,t_s";
  const std::vector<std::string> names = {"tau", "tau_replayed"};
  const auto joints = logger::joints_in_columns(names, labels_.name);
  for (const std::string& name : names) {
    for (std::size_t i = 0; i < joints.size(); ++i) {
      csv_ << ','
           << diagnostics::csv_field(
                  logger::column_name(name, joints[i], labels_.effort[i] == "N" ? "N" : "Nm"));
    }
  }
  csv_ << '\n';
  if (!csv_) file_.refuse(std::strerror(errno));
}

void WhatIf::add(std::int64_t tick, const robot::Vector& recorded, const robot::Vector& replayed) {
  const double t_s = static_cast<double>(tick) * period_s_;
  csv_ << fmt::format("{},{:.17g}", tick, t_s);
  for (const auto* tau : {&recorded, &replayed}) {
    for (const double value : *tau) csv_ << fmt::format(",{:.17g}", value);
  }
  csv_ << '\n';
  for (std::size_t i = 0; i < joints_.size(); ++i) {
    const auto joint = static_cast<Eigen::Index>(i);
    joints_[i].recorded.add(t_s, recorded[joint]);
    joints_[i].replayed.add(t_s, replayed[joint]);
    joints_[i].difference.add(t_s, replayed[joint] - recorded[joint]);
  }
}

void WhatIf::finish() {
  csv_.close();
  if (!csv_) file_.refuse(std::strerror(errno));
  file_.finish();
}

std::string WhatIf::figure(const std::string& title, const std::filesystem::path& svg) const {
  std::vector<report::Chart> charts;
  for (std::size_t i = 0; i < joints_.size(); ++i) {
    const std::string label =
        fmt::format("{}  [{}]", report::indexed("τ", i, labels_.name[i]), labels_.effort[i]);
    report::Chart torque;
    torque.height_px = 220;
    torque.y_label = label;
    torque.curves = {{"recorded", joints_[i].recorded.points(), report::palette[5], 3.5, "", {}},
                     {"replayed", joints_[i].replayed.points(), report::palette[1], 1.2, "", {}}};
    report::Chart difference;
    difference.height_px = 170;
    difference.y_label = "Δ" + label;
    difference.curves = {
        {"replayed − recorded", joints_[i].difference.points(), report::palette[0], 1.2, "", {}}};
    torque.wide = difference.wide = true;
    charts.insert(charts.end(), {std::move(torque), std::move(difference)});
  }
  return report::stacked_chart_commands(charts, title, svg);
}

Comparison compare(logger::RunLog& log, const std::vector<std::string>& overrides,
                   const controller::MakeLaw& make_law, const std::filesystem::path& out,
                   const robot::JointLabels& labels) {
  require_of_controller(overrides);
  Comparison result{
      {},
      experiment::parse_scenario(log.info().scenario, log.info().robot_description,
                                 fmt::format("{} (RUN_INFO)", log.path().string()), overrides),
      "",
      {},
      {}};
  const std::filesystem::path folder = out.empty() ? log.path().parent_path() : out;
  std::error_code error;
  result.csv = folder / "replay.csv";
  result.svg = folder / "replay.svg";
  controller::ScenarioLaw law = make_law(result.scenario);  // complains before files are made
  if (result.scenario.controller.law == experiment::external_law) {
    result.scenario.controller.announced = controller::law_info(law).name;
  }
  const std::string was = log.scenario().controller.law_text();
  const std::string is = result.scenario.controller.law_text();
  result.title = fmt::format("{}: recorded under {}, replayed {}", log.scenario().name, was,
                             is == was ? "with other settings" : fmt::format("under {}", is));

  if (!folder.empty()) std::filesystem::create_directories(folder, error);
  WhatIf what_if(result.csv, log.info().period_s, labels);
  result.replay = replay(log, result.scenario, std::move(law),
                         [&](std::int64_t tick, const auto& recorded, const auto& replayed) {
                           what_if.add(tick, recorded, replayed);
                         });
  diagnostics::UnfinishedFile svg(result.svg, remedy);
  if (result.replay.compared > 0) {
    report::draw(what_if.figure(result.title, svg.name()), svg.name());
    svg.finish();
  }
  what_if.finish();
  return result;
}

std::string comparison_text(const Comparison& comparison, const robot::JointLabels& labels,
                            double period_s) {
  const Replay& replay = comparison.replay;
  const std::vector<std::string> names = report::joint_column(labels.name);
  const std::size_t width = names.front().size();
  std::string text = fmt::format(
      "{}\n{} ticks, {} of them with another command\n\n"
      "  {:<{}}  {:>37}   {:>25}\n  {:<{}}  {:>12} {:>11} {:>12}   {:>12} {:>12}\n",
      comparison.title, replay.compared, replay.different, "joint", width,
      "replayed - recorded torque", "peak torque", "", width, "max", "at", "rms", "recorded",
      "replayed");
  for (std::size_t i = 0; i < replay.joints.size(); ++i) {
    const TorqueDifference& joint = replay.joints[i];
    text += fmt::format("  {}  {:12.5g} {:9.4g} s {:12.5g}   {:12.5g} {:12.5g} {}\n", names[i],
                        joint.max, static_cast<double>(joint.max_tick) * period_s, joint.rms,
                        joint.recorded_peak, joint.replayed_peak, labels.effort[i]);
  }
  return text + fmt::format("\n  {}\n  {}\n", comparison.svg.string(), comparison.csv.string());
}

nlohmann::ordered_json to_json(const Replay& replay) {
  nlohmann::ordered_json json;
  json["compared_ticks"] = replay.compared;
  json["different_ticks"] = replay.different;
  json["last_compared_tick"] =
      replay.compared > 0 ? nlohmann::json(replay.last_compared) : nlohmann::json();
  json["complete"] = replay.complete();
  json["ticks_without_command"] = replay.without_command;
  json["ticks_passed_over"] = replay.passed_over;
  json["stopped_by"] =
      replay.stopped_by.empty() ? nlohmann::json() : nlohmann::json(replay.stopped_by);
  json["first_difference"] = nullptr;
  if (const auto& first = replay.first) {
    json["first_difference"] = {{"tick", first->tick},
                                {"joint", first->joint + 1},
                                {"recorded_Nm", first->recorded},
                                {"replayed_Nm", first->replayed},
                                {"difference_Nm", first->replayed - first->recorded},
                                {"ulps", first->ulps}};
  }
  json["joints"] = nlohmann::ordered_json::array();
  for (const TorqueDifference& joint : replay.joints) {
    if (replay.compared == 0) break;
    json["joints"].push_back({{"max_Nm", joint.max},
                              {"max_tick", joint.max_tick},
                              {"rms_Nm", joint.rms},
                              {"recorded_peak_Nm", joint.recorded_peak},
                              {"replayed_peak_Nm", joint.replayed_peak}});
  }
  return json;
}

}  // namespace tachless::replay
