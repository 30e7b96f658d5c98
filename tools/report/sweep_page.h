#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "report/figure.h"
#include "report/sweep_map.h"
#include "study/sweep.h"

/// The results of a sweep in figures, curves or maps, and as a page. Runs nothing.
namespace tachless::report {

/// Whether a sweep is shown by curves over its first axis, one for each law: a grid of one axis, or
/// one whose other axes are lists ("KEY=a,b") of at most four combinations, which get a column of
/// diagrams each. Others are shown by a map for each law, over the first two axes.
bool shown_by_curves(const study::SweepPlan& plan);

/// What is shown of such a sweep, as indices into `measure_columns`; empty: outcomes.
/// @param colour "outcome", or names of measures with commas between (a map shows one)
/// @throw base::Failure(bad_usage) when there is no such measure, or too many
std::vector<std::size_t> measures_shown(const study::SweepPlan& plan, const std::string& colour);

/// A row of diagrams for each of `measures`, indices into `measure_columns`. Runs that were stopped
/// early have no value: they are marked at the upper edge.
Figure curves_figure(const study::SweepPlan& plan, const std::vector<study::SweepRow>& rows,
                     const std::vector<std::size_t>& measures);

/// Writes map.svg and index.html into `directory`: curves, or maps; and how many runs ended how.
/// Of a grid with more axes, a cell of a map shows its worst outcome or its largest measure. Of a
/// comparison it writes index.html alone, with a table. `certified` is drawn into its maps.
/// @throw base::Failure(bad_usage) as `measures_shown`, or when a file cannot be written
void write_sweep_page(const study::SweepPlan& plan, const std::vector<study::SweepRow>& rows,
                      const std::string& colour, const std::filesystem::path& directory,
                      const Outlines& certified = {});

}  // namespace tachless::report
