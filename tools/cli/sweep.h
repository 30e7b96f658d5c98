#pragma once

#include <string>

#include "study/sweep.h"

/// The results of `tachless sweep`, and its tasks on a cluster under Slurm. Each part is a task of
/// a job array. Each task writes its own file in the sweep's directory, which all nodes share. This
/// code runs and schedules nothing.
namespace tachless::cli {

/// Writes results.csv, index.html and map.svg of a finished sweep into its directory. A comparison
/// of laws gets trade_off.svg instead of map.svg.
/// @param colour as for `report::measures_shown`
/// @return number of runs with each outcome, over all laws: lines for people, or JSON
/// @throw base::Failure as `study::Sweep::rows` and `report::write_sweep_page`
std::string write_sweep_results(const study::Sweep& sweep, const std::string& colour, bool json);

/// Submits the array, and the job that merges its results after it.
/// @param colour as for `report::measures_shown`
/// @return lines for people: the jobs, and how to watch them
/// @throw base::Failure(bad_usage) when sbatch cannot be started or refuses
std::string submit_to_slurm(const study::Sweep& sweep, int tasks, const std::string& colour);

/// Returns lines for people: the finished runs of each file, and the state of the array's tasks.
std::string slurm_status(const study::Sweep& sweep);

}  // namespace tachless::cli
