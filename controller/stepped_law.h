#pragma once

#include <Eigen/Core>
#include <array>
#include <functional>
#include <span>
#include <vector>

#include "controller/law/law.h"
#include "messages/measurements.h"
#include "scenario/scenario.h"

/// A scenario's law for analysis: the law as functions of vectors, and its declared Lyapunov
/// function. The registry's library compiles each law once for all uses.
namespace tachless::controller {

/// Returns the entries of the vectors, one vector after the other; null pointers are skipped.
Eigen::VectorXd packed(std::span<Vector* const> vectors);
/// Fills the vectors from `from` in the order of `packed`; the sizes of the vectors stay.
void unpack(const Eigen::VectorXd& from, std::span<Vector* const> vectors);

/// Copies the plant's state into the parts of a measurement, by `messages::Part`; a null part is
/// not measured.
/// @return the measured parts that are not empty; the motors of a rigid robot are empty
std::vector<messages::Part> measure(const std::array<Vector, 4>& state,
                                    std::span<Vector* const> parts);

/// A law with a fixed reference as functions of vectors. `memory` and `measurement` hold the values
/// at rest on the reference. `start` returns the start memory for a measurement.
struct SteppedLaw {
  law::LawStep step;
  std::function<Eigen::VectorXd(const Eigen::VectorXd&)> start;
  Eigen::VectorXd memory, measurement;
  std::vector<messages::Part> measured;
};

/// Returns the scenario's law as functions of vectors.
/// @param state the plant's state on that reference, by `messages::Part`
/// @return without functions if `LawFacts::no_linearisation` gives a reason
/// @throw base::Failure(bad_usage) as `scenario_law`
SteppedLaw stepped_law(const scenario::Scenario& scenario,
                       const messages::ReferencePoint& reference,
                       const std::array<Vector, 4>& state);

/// Lyapunov function of a law's stability proof, as a function of a state of the loop [J].
using LyapunovFunction =
    std::function<double(const law::LoopState&, const messages::ReferencePoint&)>;

/// Returns the Lyapunov function of the scenario's law. It uses the law's model; a payload unknown
/// to the law is not in M. The result is empty if the law declares no Lyapunov function.
/// @param weights weights of the function's cross terms; `lyapunov::certified_run` computes them
/// @throw base::Failure(bad_usage) if the scenario gives no valid law.
LyapunovFunction lyapunov_function(const scenario::Scenario& scenario,
                                   const law::LyapunovWeights& weights = {});

}  // namespace tachless::controller
