#pragma once

#include <array>
#include <cstddef>
#include <string_view>
#include <vector>

#include "report/figure.h"
#include "study/sweep.h"

/// The maps of a sweep, over its first two axes, and how a run's outcome is shown.
namespace tachless::report {

/// A line in the map of each law.
using Outlines = std::vector<std::vector<study::Point>>;

inline constexpr std::size_t usual_measure = 1;  // rms_error

/// How each outcome is shown on a map.
inline constexpr std::array<std::string_view, names(study::Outcome()).size()> outcome_colours = {
    "#009E73", "#56B4E9", "#BBBBBB", "#E69F00", "#B8860B", "#CC79A7", "#D55E00", "#000000"};

/// A map for each law. Of several runs at one place it shows the worst outcome, or the largest of
/// the measure that `colour` begins with. @param certified of each law what is drawn as certified,
/// or nothing
Figure maps_figure(const study::SweepPlan& plan, const std::vector<study::SweepRow>& rows,
                   const std::vector<std::size_t>& colour, const Outlines& certified = {});

}  // namespace tachless::report
