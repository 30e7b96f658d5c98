#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "study/sweep.h"

/// The results of a sweep as curves over its first axis, one for each law. Of many axes: the map of
/// sweep_page.h.
namespace tachless::report {

/// Whether a sweep is shown by curves: a grid of one axis, or one whose other axes are lists
/// ("KEY=a,b") of at most four combinations, which get a column of diagrams each.
bool shown_by_curves(const study::SweepPlan& plan);

/// gnuplot's commands for a row of diagrams for each of `measures`, indices into `measure_columns`.
/// Runs that were broken off have no value: they are marked at the upper edge.
std::string sweep_curves(const study::SweepPlan& plan, const std::vector<study::SweepRow>& rows,
                         const std::vector<std::size_t>& measures,
                         const std::filesystem::path& svg);

}  // namespace tachless::report
