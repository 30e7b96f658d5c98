#pragma once

#include <filesystem>

#include "certificate/certify.h"

namespace tachless::report {

/// Draws what `tachless certify` has found: margin and spectral radius against the period, spectral
/// radius along the reference where it moves, and for each joint the section of the certified
/// level sets in its error and its rate, with the scenario's initial state. In a section all other
/// coordinates are the initial state's where that is certified (so the point is inside), and zero
/// elsewhere. What there is not is left out.
/// @throw diagnostics::Failure(bad_usage) as `draw`
void draw_certificate(const certificate::Certificate& certificate,
                      const experiment::Scenario& scenario, const std::filesystem::path& svg);

}  // namespace tachless::report
