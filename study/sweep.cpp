#include "study/sweep.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <fstream>
#include <mutex>
#include <system_error>

#include "certificate/parallel.h"
#include "diagnostics/failure.h"
#include "diagnostics/file_text.h"
#include "diagnostics/text.h"
#include "study/measures.h"

namespace tachless::study {
namespace {

namespace fs = std::filesystem;
using diagnostics::ExitCode;
using diagnostics::Failure;

constexpr std::int64_t ticks_between_looks = 256;  // whether to go on

std::string field(double value) { return std::isnan(value) ? "" : diagnostics::shortest(value); }

std::string row_text(const SweepCase& which, const Measures& measures) {
  std::string row = fmt::format("{},{}", which.index, which.law);
  for (const double value : which.values) row += "," + field(value);
  row += fmt::format(",{}", measures.outcome());
  for (const MeasureColumn& column : measure_columns()) row += "," + field(column.value(measures));
  return row + "," + diagnostics::csv_field(diagnostics::one_line(measures.stopped)) + "\n";
}

/// The file that a shard's rows are added to, held against other processes.
class RowFile {
 public:
  explicit RowFile(const fs::path& path) : path_(path) {
    file_ = ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666);
    if (file_ < 0) fail(errno);
    if (::flock(file_, LOCK_EX | LOCK_NB) != 0) {
      throw diagnostics::bad_usage(
          "{}: another process runs this part of the sweep; wait for it, or end it", path.string());
    }
    // What a broken off write has left of its line makes room for the next.
    const std::string before = diagnostics::file_text(path).value_or("");
    const std::size_t end = before.rfind('\n');
    const auto whole = static_cast<off_t>(end == std::string::npos ? 0 : end + 1);
    if (::ftruncate(file_, whole) != 0 || ::lseek(file_, whole, SEEK_SET) < 0) fail(errno);
  }
  RowFile(const RowFile&) = delete;
  RowFile& operator=(const RowFile&) = delete;
  ~RowFile() { ::close(file_); }

  void append(std::string_view line) const {
    while (!line.empty()) {
      const ssize_t written = ::write(file_, line.data(), line.size());
      if (written < 0 && errno != EINTR) fail(errno);
      if (written > 0) line.remove_prefix(static_cast<std::size_t>(written));
    }
  }

 private:
  [[noreturn]] void fail(int error) const {
    throw diagnostics::bad_usage("{}: cannot be written: {}", path_.string(),
                                 std::generic_category().message(error));
  }

  fs::path path_;
  int file_ = -1;
};

/// NaN where there is none.
double value_of(const std::string& text) {
  double value = NAN;
  std::from_chars(text.data(), text.data() + text.size(), value);
  return value;
}

}  // namespace

Sweep Sweep::begin(const fs::path& directory, const SweepPlan& plan) {
  const fs::path file = directory / "plan.json";
  const std::string json = plan.json();
  std::error_code error;
  fs::create_directories(directory, error);
  if (error) {
    throw diagnostics::bad_usage("{}: cannot be made: {}", directory.string(), error.message());
  }
  if (!fs::exists(file)) {
    diagnostics::UnfinishedFile(file, "name another directory with --out").write(json);
  } else if (diagnostics::file_text(file) != json) {
    throw diagnostics::bad_usage(
        "{}: another sweep is in this directory; name another one with --out, or remove it",
        directory.string());
  }
  return {directory, plan};
}

Sweep Sweep::open(const fs::path& directory) {
  const fs::path file = directory / "plan.json";
  if (!fs::is_regular_file(file)) {
    throw diagnostics::bad_usage("{}: no sweep: there is no plan.json", directory.string());
  }
  return {directory,
          SweepPlan::from_json(diagnostics::file_text(file).value_or(""), file.string())};
}

template <class F>
void Sweep::for_each_row(const F& f) const {
  // The last field may be quoted.
  const std::size_t num_fields = 4 + plan_.axes.size() + measure_columns().size();
  for (const fs::directory_entry& entry : fs::directory_iterator(directory_)) {
    const std::string name = entry.path().filename().string();
    if (!name.starts_with("rows-") || !name.ends_with(".csv")) continue;
    std::ifstream file(entry.path(), std::ios::binary);
    std::string line;
    for (int number = 1; std::getline(file, line); ++number) {
      if (file.eof()) break;  // broken off: no line end
      const std::vector<std::string> fields = split(line, ',', num_fields);
      const char* end = fields[0].data() + fields[0].size();
      std::int64_t index = -1;
      const auto [read_to, error] = std::from_chars(fields[0].data(), end, index);
      if (fields.size() != num_fields || error != std::errc() || read_to != end || index < 0 ||
          index >= plan_.num_cases()) {
        throw diagnostics::bad_usage(
            "{}:{}: no row of this sweep; remove the line, and its run is made again",
            entry.path().string(), number);
      }
      f(index, line, fields, name);
    }
  }
}

std::vector<bool> Sweep::finished() const {
  std::vector<bool> result(static_cast<std::size_t>(plan_.num_cases()));
  for_each_row([&](std::int64_t index, const auto&... /*row*/) {
    result[static_cast<std::size_t>(index)] = true;
  });
  return result;
}

std::map<std::string, std::int64_t> Sweep::counts() const {
  std::map<std::string, std::int64_t> result;
  for_each_row([&](std::int64_t /*index*/, const auto& /*line*/, const auto& /*fields*/,
                   const std::string& file) { ++result[file]; });
  return result;
}

bool Sweep::run(const Shard& shard, int threads, const std::function<bool()>& go_on,
                const OnProgress& on_progress) const {
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
  certificate::parallel_for(
      todo.size(),
      [&](std::size_t k) {
        if (!go_on()) return;
        const SweepCase which = plan_.at(todo[k]);
        const auto measures = measure(plan_.scenario(which), [&](const TickRecord& tick) {
          return tick.tick % ticks_between_looks != 0 || go_on();
        });
        if (!measures) return;
        const std::string row = row_text(which, *measures);
        const std::lock_guard lock(mutex);
        file.append(row);
        on_progress(++done, all);
      },
      static_cast<unsigned>(threads));
  return done == all;
}

std::vector<SweepRow> Sweep::rows() const {
  const std::size_t columns = measure_columns().size(), axes = plan_.axes.size();
  std::vector<SweepRow> rows(static_cast<std::size_t>(plan_.num_cases()));
  for_each_row([&](std::int64_t index, const std::string& line,
                   const std::vector<std::string>& fields, const auto& /*file*/) {
    SweepRow row{line, plan_.at(index), fields[2 + axes], {}, fields.back()};
    for (std::size_t i = 0; i < columns; ++i) {
      row.measures.push_back(value_of(fields[3 + axes + i]));
    }
    rows[static_cast<std::size_t>(index)] = std::move(row);
  });
  const auto missing =
      std::ranges::count_if(rows, [](const SweepRow& row) { return row.line.empty(); });
  if (missing > 0) {
    throw Failure(ExitCode::check_said_no,
                  "{}: {} of {} runs are not finished; go on with: tachless sweep {}",
                  directory_.string(), missing, rows.size(), directory_.string());
  }
  return rows;
}

std::string Sweep::table(const std::vector<SweepRow>& rows) const {
  std::string table = "case,law";
  for (const Axis& axis : plan_.axes) table += "," + axis.name();
  table += ",outcome";
  for (const MeasureColumn& column : measure_columns()) table += fmt::format(",{}", column.name);
  table += ",stopped\n";
  for (const SweepRow& row : rows) table += row.line + "\n";
  return table;
}

}  // namespace tachless::study
