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

namespace tachless::scenario {
namespace {

namespace fs = std::filesystem;

std::string digest_of(std::string_view text) { return fmt::format("{:016x}", base::fnv(text)); }

/// @param digest that it must have; empty: any
std::string table_text(const Scenario& scenario, const fs::path& path, std::string_view digest) {
  std::string text;
  try {
    text = base::given_text(path);
  } catch (const base::Failure& failure) {
    throw scenario.complaint("reference.file", failure.what());
  }
  if (digest.empty() || digest == digest_of(text)) return text;
  throw scenario.complaint("reference.file.digest", "{}, but that of {} is {}: it is another table",
                           digest, path.string(), digest_of(text));
}

class Table {
 public:
  Table(const std::string& source, const robot::Model& model) : source_(source), model_(model) {
    for (int i = 0; i <= model.num_joints; ++i) columns_.push_back(static_cast<std::size_t>(i));
  }

  void add_line(std::string_view line) {
    ++line_;
    base::split_row(line.substr(0, line.find('#')), fields_);
    if (fields_.empty()) return;
    if (time_s_.empty() && !base::number_in(fields_.front())) {
      read_header();
    } else {
      read_row();
    }
  }

  reference::trajectory::WaypointSpline spline() {
    if (time_s_.size() < 2) refuse("{} rows; allowed: at least 2", time_s_.size());
    const auto rows = static_cast<Eigen::Index>(time_s_.size());
    Eigen::MatrixXd position =
        Eigen::Map<const Eigen::MatrixXd>(positions_.data(), model_.num_joints, rows);
    positions_ = {};
    return {std::move(time_s_), std::move(position)};
  }

 private:
  template <class... Args>
  [[noreturn]] void refuse(fmt::format_string<Args...> text, Args&&... args) const {
    throw std::invalid_argument(fmt::format("{}:{}: ", source_, line_) +
                                fmt::format(text, std::forward<Args>(args)...));
  }

  /// The only column that has one of `names`.
  std::size_t column(const std::vector<std::string_view>& names, std::string_view what) const {
    const auto is_wanted = [&](std::string_view field) {
      return std::find(names.begin(), names.end(), field) != names.end();
    };
    const auto found = std::find_if(fields_.begin(), fields_.end(), is_wanted);
    if (found == fields_.end()) {
      refuse("no column {}; there are {}", what, base::joined(fields_));
    }
    if (std::find_if(found + 1, fields_.end(), is_wanted) != fields_.end()) {
      refuse("two columns {}", what);
    }
    return static_cast<std::size_t>(found - fields_.begin());
  }

  /// Which column is the time, which is each joint; others are left out.
  void read_header() {
    columns_ = {column({"time", "time_s", "t_s"}, "for the time (time, time_s, t_s)")};
    for (const std::string& joint : model_.joint_names) {
      columns_.push_back(column({joint}, fmt::format("\"{}\", which is a joint", joint)));
    }
    width_ = fields_.size();
  }

  void read_row() {
    if (width_ == 0) width_ = columns_.size();  // no header: the time and the joints in order
    if (fields_.size() != width_) {
      refuse("{} columns; allowed: {}{}", fields_.size(), width_,
             width_ == columns_.size() ? ", the time and a position for each joint" : "");
    }
    const double t = value(0);
    if (!time_s_.empty() && !(t > time_s_.back())) {
      refuse("time {:g} s is not after {:g} s; allowed: increasing times", t, time_s_.back());
    }
    for (int i = 0; i < model_.num_joints; ++i) add_position(i, t);
    time_s_.push_back(t);
  }

  double value(std::size_t column) const {
    const std::string_view field = fields_[columns_[column]];
    const std::optional<double> x = base::number_in(field);
    if (!x || !std::isfinite(*x)) refuse("\"{}\" is not a finite number", field);
    return *x;
  }

  [[nodiscard]] std::string joint(int i) const {
    return robot::joint_labels(model_).joint(static_cast<std::size_t>(i));
  }

  void add_position(int i, double t) {
    const double q = value(static_cast<std::size_t>(i) + 1);
    if (q < model_.lower[i] || q > model_.upper[i]) {
      refuse("{} is at {:g}; allowed by the URDF: {:g} to {:g}", joint(i), q, model_.lower[i],
             model_.upper[i]);
    }
    if (!time_s_.empty()) {
      const double before =
          positions_[positions_.size() - static_cast<std::size_t>(model_.num_joints)];
      const double speed = std::abs(q - before) / (t - time_s_.back());
      if (speed > model_.velocity_limit[i]) {
        refuse("{} moves at {:g} per second since the row before; allowed by the URDF: {:g}",
               joint(i), speed, model_.velocity_limit[i]);
      }
    }
    positions_.push_back(q);
  }

  const std::string& source_;
  const robot::Model& model_;
  std::size_t line_ = 0, width_ = 0;
  std::vector<std::size_t> columns_;  ///< of the time and of each joint
  std::vector<std::string_view> fields_;
  std::vector<double> time_s_, positions_;
};

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
  try {
    file->motion = std::make_shared<const reference::trajectory::WaypointSpline>(
        parse_motion(table_text(scenario, path, file->digest), path.string(), *scenario.model));
  } catch (const std::invalid_argument& refused) {
    throw base::bad_usage(refused.what());
  }
}

reference::trajectory::WaypointSpline parse_motion(std::string_view text, const std::string& source,
                                                   const robot::Model& model) {
  Table table(source, model);
  while (!text.empty()) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    table.add_line(text.substr(0, end));
    text.remove_prefix(std::min(end + 1, text.size()));
  }
  return table.spline();
}

}  // namespace tachless::scenario
