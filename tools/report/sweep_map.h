#pragma once

#include <array>
#include <cstddef>
#include <string_view>
#include <vector>

#include "report/figure.h"
#include "study/sweep.h"

/// The maps of a sweep over its first two axes, and the colours of the runs' outcomes.
namespace tachless::report {

/// Outlines of the certified regions in the maps, one per law: points in the first two axes.
using Outlines = std::vector<std::vector<study::Point>>;

/// Column of the measure that is shown unless another one is asked for: rms_error.
inline constexpr std::size_t usual_measure = 1;

/// Colour of each outcome on a map.
inline constexpr std::array<std::string_view, names(study::Outcome()).size()> outcome_colours = {
    "#009E73", "#56B4E9", "#BBBBBB", "#E69F00", "#B8860B", "#CC79A7", "#D55E00", "#000000"};

/// Returns a figure with a map for each law. A place with several runs shows the worst outcome, or
/// the largest value of the measure.
/// @param colour the first entry is the column of the measure that gives the colours; empty: the
/// outcomes give them
/// @param certified outline of each law's certified region; empty: none is drawn
Figure maps_figure(const study::SweepPlan& plan, const std::vector<study::SweepRow>& rows,
                   const std::vector<std::size_t>& colour, const Outlines& certified = {});

}  // namespace tachless::report
