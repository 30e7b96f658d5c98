#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "study/sweep.h"

namespace tachless::report {

/// Writes map.svg and index.html into `directory`: curves (sweep_curves.h), or for each law a map
/// over the first two axes; and how many runs ended how. `colour` is "outcome", the names of
/// measures with commas between (a map shows one), or "certified": outcomes, and the runs whose
/// initial state is in the certified region marked. Of a grid with more axes, a cell shows its
/// worst outcome or its largest measure.
/// @throw diagnostics::Failure(bad_usage) when there is no such measure, or gnuplot cannot draw
void write_sweep_page(const study::SweepPlan& plan, const std::vector<study::SweepRow>& rows,
                      const std::string& colour, const std::filesystem::path& directory);

}  // namespace tachless::report
