#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "study/sweep.h"

namespace tachless::report {

/// Writes map.svg and index.html into `directory`: for each law, a map over the first two axes (a
/// curve, when there is one axis only), coloured by `colour`, which is "outcome" or a measure's
/// name; and how many runs ended how. Of a grid with more axes, a cell shows its worst outcome or
/// its largest measure.
/// @throw diagnostics::Failure(bad_usage) when there is no such measure, or gnuplot cannot draw
void write_sweep_page(const study::SweepPlan& plan, const std::vector<study::SweepRow>& rows,
                      const std::string& colour, const std::filesystem::path& directory);

}  // namespace tachless::report
