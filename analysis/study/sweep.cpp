#include "study/sweep.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <system_error>
#include <utility>

#include "base/failure.h"
#include "base/file_descriptor.h"
#include "base/file_text.h"
#include "base/parallel.h"
#include "base/text.h"
#include "scenario/table.h"

namespace tachless::study {
namespace {

namespace fs = std::filesystem;
using base::ExitCode;
using base::Failure;

constexpr std::int64_t ticks_between_looks = 256;  // whether to go on

std::string field(double value) { return std::isnan(value) ? "" : base::shortest(value); }

std::string head_of(const SweepPlan& plan) {
  std::string head = "case,law";
  for (const Axis& axis : plan.axes) head += "," + axis.name();
  head += ",outcome";
  for (const MeasureColumn& column : measure_columns(plan.is_comparison())) {
    head += fmt::format(",{}", column.name);
  }
  return head + ",stopped\n";
}

/// A row as text: the fields of `head_of`.
std::string row_text(const SweepPlan& plan, const SweepCase& which, const Measures& measures) {
  std::string row = fmt::format("{},{}", which.index, which.law);
  for (const double value : which.values) row += "," + field(value);
  row += fmt::format(",{}", measures.verdict.word());
  for (const MeasureColumn& column : measure_columns(plan.is_comparison())) {
    row += "," + field(column.value(measures));
  }
  return row + "," + base::csv_field(base::one_line(measures.verdict.reason)) + "\n";
}

/// Returns a row of the file, given without its line end; nothing when it is none of this plan.
std::optional<SweepRow> row_of(const SweepPlan& plan, const std::string& line) {
  const std::size_t values = plan.axes.size();
  const auto columns = measure_columns(plan.is_comparison());
  const std::size_t reason = 3 + values + columns.size();  // the last field; it may be empty
  try {
    scenario::Table table(line, "row");
    if (!table.next() || table.width() < reason || table.width() > reason + 1) return {};
    const double index = table.number(0);
    const auto outcome = base::value_of<Outcome>(table.text(2 + values));
    if (!(index >= 0) || index >= static_cast<double>(plan.num_cases()) ||
        index != std::floor(index) || !outcome) {
      return {};
    }
    SweepRow row{line, plan.at(static_cast<std::int64_t>(index)), *outcome, {}, {}};
    if (table.width() > reason) row.stopped = table.text(reason);
    for (std::size_t i = 0; i < columns.size(); ++i) {
      row.measures.push_back(base::number_in(table.text(3 + values + i)).value_or(NAN));
    }
    return row;
  } catch (const std::invalid_argument&) {
    return {};
  }
}

/// The file that a shard's rows are added to, held against other processes.
class RowFile {
 public:
  explicit RowFile(const fs::path& path)
      : path_(path), file_(::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666)) {
    if (file_.get() < 0) fail(errno);
    if (::flock(file_.get(), LOCK_EX | LOCK_NB) != 0) {
      throw base::bad_usage(
          "{}: another process runs this part of the sweep; wait for it, or end it", path.string());
    }
    // A write that was broken off may have left part of a line. The file is cut after its last
    // whole line.
    const std::string before = base::file_text(path).value_or("");
    const std::size_t end = before.rfind('\n');
    const auto whole = static_cast<off_t>(end == std::string::npos ? 0 : end + 1);
    if (::ftruncate(file_.get(), whole) != 0 || ::lseek(file_.get(), whole, SEEK_SET) < 0)
      fail(errno);
  }

  void append(std::string_view line) const {
    while (!line.empty()) {
      const ssize_t written = ::write(file_.get(), line.data(), line.size());
      if (written < 0 && errno != EINTR) fail(errno);
      if (written > 0) line.remove_prefix(static_cast<std::size_t>(written));
    }
  }

 private:
  [[noreturn]] void fail(int error) const {
    throw base::bad_usage("{}: cannot be written: {}; see its permissions and the free space",
                          path_.string(), std::generic_category().message(error));
  }

  fs::path path_;
  base::FileDescriptor file_;
};

}  // namespace

Sweep Sweep::begin(const fs::path& directory, const SweepPlan& plan) {
  const fs::path file = directory / "plan.json";
  const std::string json = plan.json();
  std::error_code error;
  fs::create_directories(directory, error);
  if (error) {
    throw base::bad_usage("{}: cannot be made: {}; name another directory with --out",
                          directory.string(), error.message());
  }
  // Shards that are started together all write the plan; the first one wins.
  const bool is_new =
      !fs::exists(file) &&
      base::UnfinishedFile(file, "name another directory with --out").write_new(json);
  if (!is_new && base::file_text(file) != json) {
    throw base::bad_usage(
        "{}: another sweep is in this directory; name another one with --out, or remove it",
        directory.string());
  }
  return {directory, plan};
}

Sweep Sweep::open(const fs::path& directory) {
  const fs::path file = directory / "plan.json";
  if (!fs::is_regular_file(file)) {
    throw base::bad_usage("{}: no sweep: there is no plan.json; name the directory of a sweep",
                          directory.string());
  }
  return {directory, SweepPlan::from_json(base::file_text(file).value_or(""), file.string())};
}

template <class F>
void Sweep::for_each_row(const F& f) const {
  for (const fs::directory_entry& entry : fs::directory_iterator(directory_)) {
    const std::string name = entry.path().filename().string();
    if (!name.starts_with("rows-") || !name.ends_with(".csv")) continue;
    std::ifstream file(entry.path(), std::ios::binary);
    std::string line;
    for (int number = 1; std::getline(file, line); ++number) {
      if (file.eof()) break;  // broken off: no line end
      auto row = row_of(plan_, line);
      if (!row) {
        throw base::bad_usage(
            "{}:{}: no row of this sweep; remove the line, and its run is made again",
            entry.path().string(), number);
      }
      f(std::move(*row), name);
    }
  }
}

std::vector<bool> Sweep::finished() const {
  std::vector<bool> result(static_cast<std::size_t>(plan_.num_cases()));
  for_each_row([&](const SweepRow& row, const std::string& /*file*/) {
    result[static_cast<std::size_t>(row.which.index)] = true;
  });
  return result;
}

std::map<std::string, std::int64_t> Sweep::counts() const {
  std::map<std::string, std::int64_t> result;
  for_each_row([&](const SweepRow& /*row*/, const std::string& file) { ++result[file]; });
  return result;
}

bool Sweep::run(const Shard& shard, int threads, const std::function<bool()>& go_on,
                const OnProgress& on_progress, const Complete& complete) const {
  const RowFile file(directory_ / fmt::format("rows-{}-of-{}.csv", shard.index, shard.count));
  const std::vector<bool> before = finished();
  std::vector<std::int64_t> todo;
  std::int64_t done = 0;
  for (std::int64_t i = shard.index - 1; i < plan_.num_cases(); i += shard.count) {
    const bool is_done = before[static_cast<std::size_t>(i)];
    done += is_done ? 1 : 0;
    if (!is_done) todo.push_back(i);
  }
  const std::int64_t all = done + static_cast<std::int64_t>(todo.size());
  std::mutex mutex;
  base::parallel_for(
      todo.size(),
      [&](std::size_t k) {
        if (!go_on()) return;
        const SweepCase which = plan_.at(todo[k]);
        const scenario::Scenario scenario = plan_.scenario(which);
        auto measures = measure(scenario, [&](const in_process::TickRecord& tick) {
          return tick.tick % ticks_between_looks != 0 || go_on();
        });
        if (!measures) return;
        if (complete) complete(scenario, *measures);
        const std::string row = row_text(plan_, which, *measures);
        const std::lock_guard lock(mutex);
        file.append(row);
        on_progress(++done, all);
      },
      static_cast<unsigned>(threads));
  return done == all;
}

std::vector<SweepRow> Sweep::rows() const {
  std::vector<SweepRow> rows(static_cast<std::size_t>(plan_.num_cases()));
  for_each_row([&](SweepRow row, const std::string& /*file*/) {
    rows[static_cast<std::size_t>(row.which.index)] = std::move(row);
  });
  const auto missing =
      std::ranges::count_if(rows, [](const SweepRow& row) { return row.line.empty(); });
  if (missing > 0) {
    throw Failure(ExitCode::check_said_no,
                  "{}: {} of {} runs are not finished; to resume: tachless sweep {}",
                  directory_.string(), missing, rows.size(), base::shell_word(directory_.string()));
  }
  return rows;
}

std::string Sweep::table(const std::vector<SweepRow>& rows) const {
  std::string table = head_of(plan_);
  for (const SweepRow& row : rows) table += row.line + "\n";
  return table;
}

}  // namespace tachless::study
