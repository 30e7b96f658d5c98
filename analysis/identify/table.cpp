// Reads positions and torques that another program has recorded. A YAML file names the columns of
// the table.

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string_view>
#include <vector>

#include "base/failure.h"
#include "base/file_text.h"
#include "base/text.h"
#include "identify/recording.h"
#include "identify/spikes.h"
#include "scenario/reader.h"
#include "scenario/table.h"

namespace tachless::identify {
namespace {

using base::bad_usage;

constexpr double most = 1e12;       ///< largest number in a table
constexpr double longest_gap = 20;  ///< in median steps
constexpr double shortest_step_s = 1e-6, longest_step_s = 0.5;

/// Names or numbers of columns, one for each joint.
struct Columns {
  std::vector<std::string> given;
};

/// Reads the columns of a key: a list of names or numbers, or one for a robot of one joint.
void read(const scenario::Place& place, Columns& to) {
  using scenario::YamlNode;
  constexpr std::string_view allowed = "a list with a column per joint, each by name or number";
  if (place.node == nullptr) throw place.complaint(fmt::format("missing; allowed: {}", allowed));
  const YamlNode& node = *place.node;
  const auto add = [&](const YamlNode& entry) {
    const std::optional<double> number = base::number_in(entry.scalar);
    if (entry.kind != YamlNode::Kind::scalar || entry.scalar.empty() || (number && *number < 1)) {
      throw place.complaint(fmt::format("{}; allowed: {}", scenario::emit_line(node), allowed));
    }
    to.given.push_back(entry.scalar);
  };
  if (node.kind == YamlNode::Kind::list) {
    for (const YamlNode& entry : node.children) add(entry);
  } else {
    add(node);
  }
  if (std::ssize(to.given) != place.scenario.num_joints) {
    throw place.complaint(fmt::format("{} has length {}, the robot has {} joints; allowed: {}",
                                      scenario::emit_line(node), to.given.size(),
                                      place.scenario.num_joints, allowed));
  }
}

/// The YAML file's keys.
struct Description {
  std::string scenario, table, time_column;
  Columns position, torque;
  Vector position_scale, torque_scale;
  double time_scale = 1, time_offset = 0;

  static constexpr std::tuple keys{
      base::Key{"scenario", &Description::scenario},
      base::Key{"table", &Description::table},
      base::Key{"time_column", &Description::time_column}.by_default(
          "the column with a usual name of the time"),
      base::Key{"time_scale", &Description::time_scale}.in(base::positive).by_default(),
      base::Key{"time_offset", &Description::time_offset}.by_default(),
      base::Key{"position_columns", &Description::position},
      base::Key{"torque_columns", &Description::torque},
      base::Key{"position_scale", &Description::position_scale}.by_default(1),
      base::Key{"torque_scale", &Description::torque_scale}.by_default(1)};
};

/// The table's rows: time, positions, torques.
class Rows {
 public:
  Rows(std::string_view text, const std::string& source, const Description& description)
      : table_(text, source), source_(source), offset_(description.time_offset) {
    columns_.push_back(table_.time_column(description.time_column, description.time_scale != 1));
    for (const Columns* each : {&description.position, &description.torque}) {
      for (const std::string& column : each->given) {
        columns_.push_back(table_.column_by_name_or_number(column));
      }
    }
    scale_ = Eigen::VectorXd(std::ssize(columns_));
    scale_ << description.time_scale, description.position_scale, description.torque_scale;
    while (table_.next()) add_row();
  }

  /// Returns the values with one column per instant.
  [[nodiscard]] Eigen::Map<const Eigen::MatrixXd> all() const {
    const auto width = std::ssize(columns_);
    return {values_.data(), width, std::ssize(values_) / width};
  }

  /// Throws for a value of the row: off from the rows around it.
  [[noreturn]] void refuse_spike(Eigen::Index row, Eigen::Index value, double off) const {
    const auto at = static_cast<std::size_t>(value);
    throw bad_usage(
        "{}:{}: {} in column {} is off by {:.3g} from the rows around it; correct or delete the "
        "line, or cut the table there",
        source_, lines_[static_cast<std::size_t>(row)], base::shortest(all()(value, row)),
        columns_[at] + 1, std::abs(off));
  }

 private:
  void add_row() {
    lines_.push_back(table_.line());
    for (std::size_t i = 0; i < columns_.size(); ++i) {
      const double value = table_.number(columns_[i]) * scale_[static_cast<Eigen::Index>(i)];
      if (i > 0 && !(std::abs(value) < most)) {
        table_.refuse(fmt::format("{} in column {}; allowed: below {:g}", base::shortest(value),
                                  columns_[i] + 1, most));
      }
      values_.push_back(i == 0 ? value + offset_ : value);
    }
    const std::size_t width = columns_.size(), last = values_.size() - width;
    if (last == 0 || values_[last] > values_[last - width]) return;
    table_.refuse(fmt::format("time {} s is not after {} s; allowed: increasing times",
                              base::shortest(values_[last]),
                              base::shortest(values_[last - width])));
  }

  scenario::Table table_;
  std::string source_;
  std::vector<std::size_t> columns_, lines_;
  Eigen::VectorXd scale_;
  double offset_;
  std::vector<double> values_;
};

/// Throws for a median step that no recording has, because the times are then in another unit.
void require_seconds(double step, const std::string& source) {
  if (step >= shortest_step_s && step <= longest_step_s) return;
  throw bad_usage(
      "{}: the usual step is {} s; allowed: {} to {} s; give the seconds of the table's unit: "
      "time_scale: 0.001 for milliseconds, 1e-9 for nanoseconds",
      source, base::shortest(step), base::shortest(shortest_step_s),
      base::shortest(longest_step_s));
}

/// Refuses a row that does not fit those around it.
/// @param even the rows on an even grid
void require_no_spike(const Rows& rows, const Recording& even) {
  const Eigen::MatrixXd all = rows.all();
  const Eigen::Index n = even.q.cols();
  for (Eigen::Index i = 0; i < 2 * n; ++i) {
    const auto spike = i < n ? position_spike(even.q.col(i)) : torque_spike(even.tau.col(i - n));
    if (!spike) continue;
    const double t = all(0, 0) + static_cast<double>(spike->row) * even.scenario.loop.period_s;
    Eigen::Index row = 0;
    (all.row(0).array() - t).abs().minCoeff(&row);
    rows.refuse_spike(row, i + 1, spike->off);
  }
}

/// Interpolates the rows linearly on an even grid.
void set_even(const Eigen::MatrixXd& rows, const std::string& source, Recording& to) {
  const Eigen::Index count = rows.cols(), n = to.scenario.num_joints;
  if (count < 2) throw bad_usage("{}: {} rows of numbers; allowed: at least 2", source, count);
  const Eigen::VectorXd step = rows.row(0).tail(count - 1) - rows.row(0).head(count - 1);
  std::vector<double> steps(step.begin(), step.end());
  std::ranges::nth_element(steps, steps.begin() + std::ssize(steps) / 2);
  const double h = steps[steps.size() / 2];
  require_seconds(h, source);
  Eigen::Index widest = 0;
  if (step.maxCoeff(&widest) > longest_gap * h) {
    throw bad_usage(
        "{}: no row from {:g} to {:g} s, but the usual step is {:g} s; cut the table "
        "there and give both parts",
        source, rows(0, widest), rows(0, widest + 1), h);
  }
  const double begin = rows(0, 0);
  const auto ticks = static_cast<Eigen::Index>((rows(0, count - 1) - begin) / h) + 1;
  to.scenario.loop.period_s = h;
  to.q.resize(ticks, n);
  to.tau.resize(ticks, n);
  for (Eigen::Index k = 0, at = 0; k < ticks; ++k) {
    const double t = begin + static_cast<double>(k) * h;
    while (at + 2 < count && rows(0, at + 1) < t) ++at;
    const double share = (t - rows(0, at)) / (rows(0, at + 1) - rows(0, at));
    const Eigen::VectorXd here = rows.col(at) + share * (rows.col(at + 1) - rows.col(at));
    to.q.row(k) = here.segment(1, n).transpose();
    to.tau.row(k) = here.tail(n).transpose();
  }
}

}  // namespace

Recording read_table(const std::filesystem::path& description) {
  scenario::Scenario file;  // source of complaints
  file.source = description.string();
  const scenario::YamlNode root =
      scenario::parse_yaml(base::given_text(description, base::max_text_bytes), file.source);
  const scenario::Place place{file, &root, ""};
  const scenario::YamlNode* scenario = root.find("scenario");
  if (scenario == nullptr || scenario->kind != scenario::YamlNode::Kind::scalar) {
    throw bad_usage(
        "{}: no scenario; allowed: a log, or a YAML file that says what the columns of a table are "
        "(scenario, table, position_columns, torque_columns)",
        file.source);
  }
  const std::filesystem::path directory = description.parent_path();
  Recording result{file.source,
                   scenario::load_scenario(directory / scenario->scalar),
                   {},
                   {},
                   /*controlled=*/false};
  if (result.scenario.robot.flexible) {
    throw bad_usage("{}: a robot with flexible joints; identify is for rigid ones", file.source);
  }
  file.num_joints = result.scenario.num_joints;
  Description described;
  read(place, described);
  const std::filesystem::path table = directory / described.table;
  const std::string text = base::given_text(table, scenario::max_table_bytes);
  try {
    const Rows rows(text, table.string(), described);
    set_even(rows.all(), table.string(), result);
    require_no_spike(rows, result);
  } catch (const std::invalid_argument& refused) {
    throw bad_usage(refused.what());
  }
  require_usable(result);
  set_own_torque(result, /*of_log=*/false);
  return result;
}

}  // namespace tachless::identify
