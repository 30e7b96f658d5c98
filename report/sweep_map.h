#pragma once

#include <array>
#include <cstddef>
#include <string_view>
#include <vector>

#include "report/figure.h"
#include "study/sweep.h"

/// The maps of a sweep, over its first two axes, and how a run's outcome is shown.
namespace tachless::report {

inline constexpr std::size_t usual_measure = 1;  // rms_error

/// How a run is marked among curves.
enum class RunMark { good, bad, broken_off };

struct OutcomeLook {
  std::string_view outcome, colour;
  RunMark mark;
};
/// From the best to the worst.
inline constexpr std::array outcome_looks = {
    OutcomeLook{"converged", "#009E73", RunMark::good},
    OutcomeLook{"followed", "#56B4E9", RunMark::good},
    OutcomeLook{"not_judged", "#BBBBBB", RunMark::good},
    OutcomeLook{"saturated", "#E69F00", RunMark::bad},
    OutcomeLook{"limit_cycle", "#CC79A7", RunMark::bad},
    OutcomeLook{"diverging", "#D55E00", RunMark::broken_off},
    OutcomeLook{"stopped", "#000000", RunMark::broken_off}};

/// The place of an outcome among them.
std::size_t severity(std::string_view outcome);

/// A map for each law. Of several runs at one place it shows the worst outcome, or the largest of
/// the measure that `colour` begins with.
Figure maps_figure(const study::SweepPlan& plan, const std::vector<study::SweepRow>& rows,
                   const std::vector<std::size_t>& colour);

}  // namespace tachless::report
