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

/// Completes the gains of the law of constant estimates to those of the scenario's law. Unknown are
/// the kinds of parameters for which the scenario gives a rate or a bound, or else the mass.
///
/// The rates of each kind are such that Yd Gamma Yd' over Kp, the mean of the joints, is at most
/// 0.5 along the reference. eps_1 and eps_2 are those of the integral's rule, made smaller until V
/// falls at every corner of the box of the unknown parameters. Where the scenario gives no bound of
/// the mass, the bound is at most 5 kg and small enough for that. Adds a warning where V does not
/// fall with any of them. Precondition: `adapts`.
/// @throw base::Failure(bad_usage)
void add_adaptation(const scenario::Scenario& scenario, Design& design);

}  // namespace tachless::design
