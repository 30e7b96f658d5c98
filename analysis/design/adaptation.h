#pragma once

#include "design/design.h"
#include "scenario/scenario.h"

/// Gains of `loria_ortega_adaptive`. The law has no linear model, because estimates that nothing
/// excites neither grow nor decay. With constant estimates it is another law of the catalogue,
/// whose gains a search finds. The gains of the adaptation follow by rules.
namespace tachless::design {

/// Returns whether the scenario's law adapts.
bool adapts(const scenario::Scenario& scenario);

/// Returns the scenario with the law of constant estimates: `loria_ortega_scheduled` where the
/// scenario gives the gain w, else `loria_ortega_rigid`. Precondition: `adapts`.
scenario::Scenario with_constant_estimates(const scenario::Scenario& scenario);

/// Adds the gains of the adaptation to the gains of the law of constant estimates. The unknown
/// parameters are the kinds for which the scenario gives a rate or a bound, or else the mass.
///
/// The rates of each kind make Yd Gamma Yd' over Kp at most 0.5 along the reference, in the mean of
/// the joints. The weights eps_1 and eps_2 begin at the values of the integral's rule. They are
/// made smaller until V falls at every corner of the box of the unknown parameters. If the scenario
/// gives no bound of the mass, the bound is at most 5 kg, and is small enough for V to fall. Adds a
/// warning if V falls with no weights. Precondition: `adapts`.
/// @throw base::Failure(bad_usage) if law, robot or reference cannot be made of the scenario
void add_adaptation(const scenario::Scenario& scenario, Design& design);

}  // namespace tachless::design
