#pragma once

#include <Eigen/Core>
#include <array>
#include <functional>
#include <span>
#include <vector>

#include "controller/law/law.h"
#include "messages/measurements.h"
#include "scenario/scenario.h"

/// A scenario's law for analysis: as functions of vectors, and the Lyapunov function that it
/// declares. Here, beside the registry, each law is compiled once for all uses.
namespace tachless::controller {

/// One after the other; null: none.
Eigen::VectorXd packed(std::span<Vector* const> vectors);
/// The reverse; the vectors have their sizes.
void unpack(const Eigen::VectorXd& from, std::span<Vector* const> vectors);

/// The parts of a measurement from the plant's state, by `messages::Part`; null: not measured.
/// @return the parts that are not empty, as motors of a rigid robot are
std::vector<messages::Part> measure(const std::array<Vector, 4>& state,
                                    std::span<Vector* const> parts);

/// A law as a function, its reference held, as vectors of numbers: memory and measurement at rest
/// there, and the memory with which it starts from a measurement.
struct SteppedLaw {
  law::LawStep step;
  std::function<Eigen::VectorXd(const Eigen::VectorXd&)> start;
  Eigen::VectorXd memory, measurement;
  std::vector<messages::Part> measured;
};

/// @param state the plant's on that reference, by `messages::Part`
/// @return without functions when `LawFacts::no_linearisation` says why
/// @throw base::Failure(bad_usage) as `scenario_law`
SteppedLaw stepped_law(const scenario::Scenario& scenario,
                       const messages::ReferencePoint& reference,
                       const std::array<Vector, 4>& state);

/// The Lyapunov function by which a law's stability is proved, of a state of the loop [J].
using LyapunovFunction =
    std::function<double(const law::LoopState&, const messages::ReferencePoint&)>;

/// Returns the Lyapunov function of the scenario's law, with the model that the law is given (a
/// payload unknown to it is not in M). Empty when the law declares none.
/// @param weights of its cross terms, where it has some: those of `lyapunov::certified_run`
/// @throw base::Failure(bad_usage) when the law cannot be made of the scenario.
LyapunovFunction lyapunov_function(const scenario::Scenario& scenario,
                                   const law::LyapunovWeights& weights = {});

}  // namespace tachless::controller
