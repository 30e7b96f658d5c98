// Positions and torques that another program has recorded: text in columns, and a YAML file that
// says which is which.

#include <algorithm>
#include <cmath>
#include <string_view>
#include <vector>

#include "base/failure.h"
#include "base/file_text.h"
#include "base/text.h"
#include "identify/recording.h"
#include "scenario/reader.h"

namespace tachless::identify {
namespace {

using base::bad_usage;

constexpr std::uintmax_t most_bytes = 512U << 20U;
constexpr double most = 1e12;       ///< of a number in a table
constexpr double longest_gap = 20;  ///< of the median step
constexpr base::Range column_number{1, 10000, false, false, true};

/// The YAML file's keys.
struct Description {
  std::string scenario, table;
  Vector position, torque, position_scale, torque_scale;
  double time = 1;

  static constexpr std::tuple keys{
      base::Key{"scenario", &Description::scenario},
      base::Key{"table", &Description::table},
      base::Key{"time_column", &Description::time}.in(column_number).by_default(),
      base::Key{"position_columns", &Description::position}.in(column_number),
      base::Key{"torque_columns", &Description::torque}.in(column_number),
      base::Key{"position_scale", &Description::position_scale}.by_default(1),
      base::Key{"torque_scale", &Description::torque_scale}.by_default(1)};
};

/// The table's rows: time, positions, torques.
class Rows {
 public:
  Rows(const std::string& source, const Description& of) : source_(source) {
    columns_.push_back(static_cast<std::size_t>(of.time));
    for (const Vector* each : {&of.position, &of.torque}) {
      for (const double column : *each) columns_.push_back(static_cast<std::size_t>(column));
    }
    scale_ = Eigen::VectorXd(std::ssize(columns_));
    scale_ << 1, of.position_scale, of.torque_scale;
  }

  void add_line(std::string_view line) {
    ++line_;
    line = line.substr(0, line.find('#'));
    line = line.substr(0, line.find_last_not_of(",; \t\r") + 1);
    base::split_row(line, fields_);
    if (fields_.empty()) return;
    if (values_.empty()) {
      const std::string_view time = fields_[std::min(columns_.front(), fields_.size()) - 1];
      if (!base::number_in(time)) return;  // a header
      width_ = fields_.size();
    }
    const auto separators =
        std::ranges::count_if(line, [](char c) { return c == ',' || c == ';'; });
    if (fields_.size() != width_ || separators >= std::ssize(fields_)) {
      throw bad_usage(
          "{}:{}: {} columns, the first row of numbers has {}; allowed: as many in each, none "
          "empty",
          source_, line_, fields_.size(), width_);
    }
    for (std::size_t i = 0; i < columns_.size(); ++i) {
      if (columns_[i] > fields_.size()) {
        throw bad_usage("{}:{}: {} columns, but column {} is asked for", source_, line_,
                        fields_.size(), columns_[i]);
      }
      const std::string_view field = fields_[columns_[i] - 1];
      const std::optional<double> value = base::number_in(field);
      if (!value || !(std::abs(*value) < most)) {
        throw bad_usage("{}:{}: \"{}\" in column {} is not a finite number below {:g}", source_,
                        line_, field, columns_[i], most);
      }
      values_.push_back(*value * scale_[static_cast<Eigen::Index>(i)]);
    }
    const std::size_t width = columns_.size(), last = values_.size() - width;
    if (last > 0 && !(values_[last] > values_[last - width])) {
      throw bad_usage("{}:{}: time {:g} s is not after {:g} s; allowed: increasing times", source_,
                      line_, values_[last], values_[last - width]);
    }
  }

  /// A column per instant.
  [[nodiscard]] Eigen::Map<const Eigen::MatrixXd> all() const {
    const auto width = std::ssize(columns_);
    return {values_.data(), width, std::ssize(values_) / width};
  }

 private:
  std::string source_;
  std::vector<std::size_t> columns_;
  Eigen::VectorXd scale_;
  std::vector<double> values_;
  std::vector<std::string_view> fields_;
  std::size_t line_ = 0, width_ = 0;
};

/// Onto an even grid, by straight lines between the rows.
void set_even(const Eigen::MatrixXd& rows, const std::string& source, Recording& to) {
  const Eigen::Index count = rows.cols(), n = to.scenario.num_joints;
  if (count < 2) throw bad_usage("{}: {} rows of numbers; allowed: at least 2", source, count);
  const Eigen::VectorXd step = rows.row(0).tail(count - 1) - rows.row(0).head(count - 1);
  std::vector<double> steps(step.begin(), step.end());
  std::ranges::nth_element(steps, steps.begin() + std::ssize(steps) / 2);
  const double h = steps[steps.size() / 2];
  Eigen::Index widest = 0;
  if (step.maxCoeff(&widest) > longest_gap * h) {
    throw bad_usage(
        "{}: nothing from {:g} to {:g} s, where the usual step is {:g} s; cut the table "
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
  scenario::Scenario file;  // for complaints
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
  const std::string text = base::given_text(table, most_bytes);
  Rows rows(table.string(), described);
  for (std::size_t begin = 0; begin < text.size();) {
    const std::size_t end = std::min(text.find('\n', begin), text.size());
    rows.add_line(std::string_view(text).substr(begin, end - begin));
    begin = end + 1;
  }
  set_even(rows.all(), table.string(), result);
  require_usable(result);
  return result;
}

}  // namespace tachless::identify
