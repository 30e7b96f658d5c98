#include "launch/sweep_results.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <vector>

#include "diagnostics/text.h"
#include "diagnostics/unfinished_file.h"
#include "logger/export.h"
#include "report/sweep_page.h"
#include "study/measures.h"

namespace tachless::launch {
namespace {

constexpr const char* remedy = "make room there";

/// The results as columns of numbers.
void write_hdf5(const study::Sweep& sweep, const std::vector<study::SweepRow>& rows,
                const SweepResults& results) {
  logger::NumberColumn law{"law", "", {}, {}}, outcome{"outcome", "", {}, {}};
  for (const study::SweepLaw& each : sweep.plan().laws) law.choices.push_back(each.name);
  for (const auto& [name, count] : results.outcomes) outcome.choices.push_back(name);
  std::vector<logger::NumberColumn> axes, measures;
  for (const study::Axis& axis : sweep.plan().axes) axes.push_back({axis.name(), "", {}, {}});
  for (const study::MeasureColumn& column : study::measure_columns()) {
    measures.push_back({std::string(column.name), std::string(column.unit), {}, {}});
  }
  const auto choice = [](logger::NumberColumn& column, const std::string& name) {
    const auto found = std::ranges::find(column.choices, name);
    column.values.push_back(static_cast<double>(found - column.choices.begin()));
  };
  for (const study::SweepRow& row : rows) {
    choice(law, row.which.law);
    choice(outcome, row.outcome);
    for (std::size_t i = 0; i < axes.size(); ++i) axes[i].values.push_back(row.which.values[i]);
    for (std::size_t i = 0; i < measures.size(); ++i) measures[i].values.push_back(row.measures[i]);
  }
  std::vector<logger::NumberColumn> all = {law};
  all.insert(all.end(), axes.begin(), axes.end());
  all.push_back(outcome);
  all.insert(all.end(), measures.begin(), measures.end());
  diagnostics::UnfinishedFile file(results.directory / "results.h5", remedy);
  logger::write_hdf5_columns(file.name(), all, {{"plan", sweep.plan().json()}});
  file.finish();
}

}  // namespace

SweepResults write_sweep_results(const study::Sweep& sweep, const std::string& colour) {
  const std::vector<study::SweepRow> rows = sweep.rows();
  SweepResults results{sweep.directory(), rows.size(), {}};
  for (const study::SweepRow& row : rows) ++results.outcomes[row.outcome];
  diagnostics::UnfinishedFile(results.directory / "results.csv", remedy).write(sweep.table(rows));
  write_hdf5(sweep, rows, results);
  report::write_sweep_page(sweep.plan(), rows, colour, results.directory);
  return results;
}

std::string to_text(const SweepResults& results) {
  std::vector<std::string> parts;
  parts.reserve(results.outcomes.size());
  for (const auto& [outcome, count] : results.outcomes) {
    parts.push_back(fmt::format("{} {}", count, outcome));
  }
  return fmt::format("{} runs: {}\n  {}\n  {}\n", results.runs, diagnostics::joined(parts),
                     (results.directory / "results.csv").string(),
                     (results.directory / "index.html").string());
}

nlohmann::ordered_json to_json(const SweepResults& results) {
  return {{"directory", results.directory.string()},
          {"runs", results.runs},
          {"outcomes", results.outcomes}};
}

}  // namespace tachless::launch
