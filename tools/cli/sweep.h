#pragma once

#include <string>

#include "study/sweep.h"

/// What `tachless sweep` does beside running cases: its results, and its tasks on a
/// cluster under Slurm, where each part is a task of a job array and writes its own file in the
/// sweep's directory, which all nodes share. Runs and schedules nothing itself.
namespace tachless::cli {

/// Writes results.csv, index.html and map.svg (of laws trade_off.svg) of a finished sweep into its
/// directory.
/// @param colour as for `report::measures_shown`
/// @return how many runs ended how, over all laws: lines for people, or JSON
/// @throw base::Failure as `study::Sweep::rows` and `report::write_sweep_page`
std::string write_sweep_results(const study::Sweep& sweep, const std::string& colour, bool json);

/// Submits the array and, to run after it, the job that merges. @param colour as above
/// @return lines for people: the jobs, and how to look after them
/// @throw base::Failure(bad_usage) when sbatch cannot be started or refuses
std::string submit_to_slurm(const study::Sweep& sweep, int tasks, const std::string& colour);

/// Lines for people: how many runs of each file are finished, and what the array's tasks are doing.
std::string slurm_status(const study::Sweep& sweep);

}  // namespace tachless::cli
