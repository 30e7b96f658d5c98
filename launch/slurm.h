#pragma once

#include <string>

#include "study/sweep.h"

/// A sweep on a cluster under Slurm: each part is a task of a job array and writes its own file in
/// the sweep's directory, which all nodes share. Schedules nothing itself.
namespace tachless::launch {

/// Submits the array and, to run after it, the job that merges.
/// @return lines for people: the jobs, and how to look after them
/// @throw diagnostics::Failure(bad_usage) when sbatch cannot be started or refuses
std::string submit_to_slurm(const study::Sweep& sweep, int tasks);

/// Lines for people: how many runs of each file are finished, and what the array's tasks are doing.
std::string slurm_status(const study::Sweep& sweep);

}  // namespace tachless::launch
