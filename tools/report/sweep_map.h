#pragma once

#include <array>
#include <cstddef>
#include <string_view>
#include <vector>

#include "report/figure.h"
#include "study/sweep.h"

/// The maps of a sweep over its first two axes, and the colours of the runs' outcomes.
namespace tachless::report {

/// Lines in the maps, one per law.
using Outlines = std::vector<std::vector<study::Point>>;

inline constexpr std::size_t usual_measure = 1;  // rms_error

/// Colour of each outcome on a map.
inline constexpr std::array<std::string_view, names(study::Outcome()).size()> outcome_colours = {
    "#009E73", "#56B4E9", "#BBBBBB", "#E69F00", "#B8860B", "#CC79A7", "#D55E00", "#000000"};

/// Returns a figure with a map for each law. Several runs at one place are shown by their worst
/// outcome, or by the largest value of the first measure in `colour`.
/// @param certified outline of the certified region for each law, or nothing
Figure maps_figure(const study::SweepPlan& plan, const std::vector<study::SweepRow>& rows,
                   const std::vector<std::size_t>& colour, const Outlines& certified = {});

}  // namespace tachless::report
