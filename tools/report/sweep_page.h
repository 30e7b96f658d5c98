#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "report/figure.h"
#include "report/sweep_map.h"
#include "study/sweep.h"

/// The results of a sweep as figures with curves or maps, and as a page. No loop is run here.
namespace tachless::report {

/// Returns whether a sweep is shown by curves over its first axis, one curve per law. Curves show a
/// grid of one axis. They also show a grid whose other axes are lists ("KEY=a,b") with at most four
/// combinations; each combination gets a column of diagrams. Other sweeps are shown by a map for
/// each law over the first two axes.
bool shown_by_curves(const study::SweepPlan& plan);

/// Returns the measures that are shown of a sweep, as indices into `measure_columns`; empty:
/// outcomes.
/// @param colour "outcome", or names of measures separated by commas (a map shows one)
/// @throw base::Failure(bad_usage) for an unknown measure, or too many
std::vector<std::size_t> measures_shown(const study::SweepPlan& plan, const std::string& colour);

/// Returns a figure with a row of diagrams for each of `measures`, which are indices into
/// `measure_columns`. Runs that were stopped early have no value and are marked at the upper edge.
Figure curves_figure(const study::SweepPlan& plan, const std::vector<study::SweepRow>& rows,
                     const std::vector<std::size_t>& measures);

/// Writes map.svg and index.html into `directory`: curves or maps, and the number of runs per
/// outcome. A cell of a map shows the worst outcome or the largest measure along further axes. For
/// a comparison, writes index.html alone, with a table.
/// @param certified outlines drawn into the maps
/// @throw base::Failure(bad_usage) as `measures_shown`, or when a file cannot be written
void write_sweep_page(const study::SweepPlan& plan, const std::vector<study::SweepRow>& rows,
                      const std::string& colour, const std::filesystem::path& directory,
                      const Outlines& certified = {});

}  // namespace tachless::report
