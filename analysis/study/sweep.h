#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "study/measures.h"
#include "study/sweep_plan.h"

/// Sweeps that use all processor cores and can be interrupted and resumed at any time. Each
/// finished run is a line in the file of its shard. The result depends on the plan alone. The
/// sweep's directory holds plan.json, rows-I-of-N.csv for shard I of N, and results.csv when all
/// runs are finished.
namespace tachless::study {

/// One of `count` parts of a sweep: the cases whose number modulo `count` is `index` - 1.
struct Shard {
  int index = 1, count = 1;
};

/// A finished run.
struct SweepRow {
  std::string line;  ///< the run's line in results.csv
  SweepCase which;
  Outcome outcome = Outcome::not_judged;
  std::vector<double> measures;  ///< in the order of `measure_columns`; NaN: the run has none
  std::string stopped;           ///< why a protective stop ended the run; empty: none did
};

/// Sweep of one plan in one directory.
class Sweep {
 public:
  /// Returns the sweep of `plan` in `directory`. Begins a new sweep, unless one of the same plan
  /// was begun there before.
  /// @throw base::Failure(bad_usage) when the directory has another plan or cannot be written.
  static Sweep begin(const std::filesystem::path& directory, const SweepPlan& plan);
  /// Returns the sweep that was begun in `directory`.
  /// @throw base::Failure(bad_usage) when there is none.
  static Sweep open(const std::filesystem::path& directory);

  [[nodiscard]] const SweepPlan& plan() const { return plan_; }
  [[nodiscard]] const std::filesystem::path& directory() const { return directory_; }

  /// Returns for each case whether its row is in one of the files. An incomplete last line does not
  /// count.
  /// @throw base::Failure(bad_usage) if a line is no row of this plan; the message names file and
  /// line
  [[nodiscard]] std::vector<bool> finished() const;

  /// Returns the number of finished runs by file.
  [[nodiscard]] std::map<std::string, std::int64_t> counts() const;

  /// Callback with the number of the shard's cases that are finished.
  using OnProgress = std::function<void(std::int64_t done, std::int64_t all)>;
  /// Callback that fills in the measures of a comparison that do not come from the run itself.
  using Complete = std::function<void(const scenario::Scenario&, Measures&)>;
  /// Runs the cases of the shard that are not finished yet.
  /// @param threads number of threads, at least 1
  /// @param go_on called repeatedly from all threads; once it returns false, the unfinished runs
  /// are discarded
  /// @param on_progress called by one thread at a time
  /// @param complete for a comparison (`SweepPlan::is_comparison`); called from all threads
  /// @return whether the shard is finished.
  /// @throw base::Failure(bad_usage) if the scenario refuses the values of a case, which the
  /// message names, or if another process runs the same shard
  bool run(const Shard& shard, int threads, const std::function<bool()>& go_on,
           const OnProgress& on_progress, const Complete& complete = {}) const;

  /// Returns all rows, in the order of their cases.
  /// @throw base::Failure(check_said_no) if rows are missing; the message gives their number
  [[nodiscard]] std::vector<SweepRow> rows() const;
  /// Returns the table of all rows that results.csv holds. It is the same to the last byte however
  /// the sweep was run.
  [[nodiscard]] std::string table(const std::vector<SweepRow>& rows) const;

 private:
  Sweep(std::filesystem::path directory, SweepPlan plan)
      : directory_(std::move(directory)), plan_(std::move(plan)) {}
  template <class F>
  void for_each_row(const F& f) const;

  std::filesystem::path directory_;
  SweepPlan plan_;
};

}  // namespace tachless::study
