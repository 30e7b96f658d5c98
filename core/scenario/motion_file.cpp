#include "scenario/motion_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <stdexcept>
#include <utility>
#include <variant>

#include "base/file_text.h"
#include "base/fnv.h"
#include "base/text.h"
#include "robot/model.h"
#include "scenario/table.h"

namespace tachless::scenario {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t max_motion_bytes = 100'000'000;

std::string digest_of(std::string_view text) { return fmt::format("{:016x}", base::fnv(text)); }

/// @param digest that it must have; empty: any
std::string table_text(const Scenario& scenario, const fs::path& path, std::string_view digest) {
  std::string text;
  try {
    text = base::given_text(path, max_motion_bytes);
  } catch (const base::Failure& failure) {
    throw scenario.complaint("reference.file", failure.what());
  }
  if (digest.empty() || digest == digest_of(text)) return text;
  throw scenario.complaint("reference.file.digest",
                           "{}, but that of {} is {}: it is another table; give the first one, or "
                           "remove the key",
                           digest, path.string(), digest_of(text));
}

/// Rows of a motion with the joints' columns, checked against the robot's limits.
class MotionRows {
 public:
  MotionRows(std::string_view text, const std::string& source, const robot::Model& model,
             const reference::trajectory::MotionFile& file)
      : model_(model), file_(file), table_(text, source) {
    columns_.push_back(table_.time_column(file.time_column, file.time_scale != 1));
    if (!table_.names().empty()) {
      for (const std::string& joint : model.joint_names) columns_.push_back(table_.column(joint));
      return;
    }
    const auto wanted = static_cast<std::size_t>(model.num_joints) + 1;
    if (table_.width() != wanted || columns_.front() != 0) {
      table_.refuse(fmt::format("{} columns; allowed: {}, the time and a position for each joint",
                                table_.width(), wanted));
    }
    for (std::size_t i = 1; i < wanted; ++i) columns_.push_back(i);
  }

  reference::trajectory::WaypointSpline spline() {
    while (table_.next()) read_row();
    if (time_s_.size() < 2) {
      table_.refuse(fmt::format("{} rows; allowed: at least 2", time_s_.size()));
    }
    const auto rows = static_cast<Eigen::Index>(time_s_.size());
    Eigen::MatrixXd position =
        Eigen::Map<const Eigen::MatrixXd>(positions_.data(), model_.num_joints, rows);
    positions_ = {};
    return {std::move(time_s_), std::move(position)};
  }

 private:
  void read_row() {
    const double t = table_.number(columns_[0]) * file_.time_scale + file_.time_offset;
    if (!time_s_.empty() && !(t > time_s_.back())) {
      table_.refuse(fmt::format("time {} s is not after {} s; allowed: increasing times",
                                base::shortest(t), base::shortest(time_s_.back())));
    }
    for (int i = 0; i < model_.num_joints; ++i) add_position(i, t);
    time_s_.push_back(t);
  }

  [[nodiscard]] std::string joint(int i) const {
    return robot::joint_labels(model_).joint(static_cast<std::size_t>(i));
  }

  void add_position(int i, double t) {
    const double q = table_.number(columns_[static_cast<std::size_t>(i) + 1]);
    if (q < model_.lower[i] || q > model_.upper[i]) {
      table_.refuse(fmt::format("{} is at {:g}; allowed by the URDF: {:g} to {:g}", joint(i), q,
                                model_.lower[i], model_.upper[i]));
    }
    if (!time_s_.empty()) {
      const double before =
          positions_[positions_.size() - static_cast<std::size_t>(model_.num_joints)];
      const double speed = std::abs(q - before) / (t - time_s_.back());
      if (speed > model_.velocity_limit[i]) {
        table_.refuse(
            fmt::format("{} moves at {:g} per second since the row before; allowed by the URDF: "
                        "{:g}",
                        joint(i), speed, model_.velocity_limit[i]));
      }
    }
    positions_.push_back(q);
  }

  const robot::Model& model_;
  const reference::trajectory::MotionFile& file_;
  Table table_;
  std::vector<std::size_t> columns_;  ///< of the time and of each joint
  std::vector<double> time_s_, positions_;
};

/// Refuses a table whose times lie outside of the run. Warns of a table that is cut by the start or
/// the end of the run.
void compare_with_run(Scenario& scenario, const std::string& source, double first, double last) {
  const double end = scenario.loop.duration_s;
  using base::shortest;
  if (first >= end || last <= 0) {
    throw base::bad_usage(
        "{}: its times go from {} to {} s and the run from 0 to {} s: nothing would move; give "
        "reference: {{file: {{path: {}, time_offset: {}}}}}, or time_scale: 0.001 for "
        "milliseconds",
        source, shortest(first), shortest(last), shortest(end),
        std::get<reference::trajectory::MotionFile>(scenario.reference).path, shortest(-first));
  }
  std::string cut;
  if (first < 0) cut = fmt::format("it begins at {} s, before the run", shortest(first));
  if (last > end) {
    cut +=
        fmt::format("{}it ends at {} s, after the run ({} s); milliseconds take time_scale: 0.001",
                    cut.empty() ? "" : "; ", shortest(last), shortest(end));
  }
  if (cut.empty()) return;
  auto warned = std::make_shared<robot::Model>(*scenario.model);
  warned->warnings.push_back(
      fmt::format("{}: the run has only a part of the motion: {}", source, cut));
  scenario.model = std::move(warned);
}

}  // namespace

void pin_motion(YamlNode& root, const Scenario& scenario, const fs::path& directory) {
  YamlNode* const reference = root.find("reference");
  YamlNode* const file = reference == nullptr ? nullptr : reference->find("file");
  if (file == nullptr) return;
  if (file->kind == YamlNode::Kind::scalar) {
    const YamlNode path = std::exchange(*file, {YamlNode::Kind::map});
    file->add("path") = path;
  }
  const YamlNode* const path = file->find("path");
  if (path == nullptr || path->kind != YamlNode::Kind::scalar) return;  // the reader says so
  if (file->find("digest") != nullptr) return;
  const std::string text = table_text(scenario, directory / path->scalar, "");
  file->add("digest") = {YamlNode::Kind::scalar, digest_of(text), true};
}

void read_motion(Scenario& scenario, const fs::path& directory) {
  auto* const file = std::get_if<reference::trajectory::MotionFile>(&scenario.reference);
  if (file == nullptr) return;
  const fs::path path = directory / file->path;
  const std::string text = table_text(scenario, path, file->digest);
  try {
    file->motion = std::make_shared<const reference::trajectory::WaypointSpline>(
        parse_motion(text, path.string(), *scenario.model, *file));
  } catch (const std::invalid_argument& refused) {
    throw base::bad_usage(refused.what());
  }
  compare_with_run(scenario, path.string(), file->motion->time_s().front(),
                   file->motion->time_s().back());
}

reference::trajectory::WaypointSpline parse_motion(std::string_view text, const std::string& source,
                                                   const robot::Model& model,
                                                   const reference::trajectory::MotionFile& file) {
  return MotionRows(text, source, model, file).spline();
}

}  // namespace tachless::scenario
