#pragma once

#include <string>
#include <vector>

#include "commission/hypotheses.h"

/// Comparison of what was found with the scenario: each misfit gets a line with its remedy, and the
/// changes of the scenario that remove it.
namespace tachless::commission {

/// Adds a misfit.
/// @param overrides remove it; empty: the scenario cannot remove it
void add_misfit(Commissioned& found, const std::string& key, const std::string& what,
                std::vector<std::string> overrides = {});

/// Returns the delay of the arm from those of its joints, if they agree.
void judge_delay(const scenario::Scenario& scenario, int whole, Commissioned& found);
/// Compares the found friction with the friction that the scenario states for an arm without
/// compensation.
void judge_friction(const scenario::Scenario& scenario, const Vector& speed,
                    const Explanation& explanation, Commissioned& found);

/// @param possible signs against the scenario's that explain the arm
void compare_signs(const scenario::Scenario& scenario, const std::vector<Vector>& possible,
                   Commissioned& found);
/// @param heavier rotor inertia of each joint beyond the scenario's [kg m^2; kg]
void compare_scales(const scenario::Scenario& scenario, const std::vector<double>& heavier,
                    Commissioned& found);
void compare_gravity(const scenario::Scenario& scenario, Commissioned& found);
void compare_delay(const scenario::Scenario& scenario, Commissioned& found);

}  // namespace tachless::commission
