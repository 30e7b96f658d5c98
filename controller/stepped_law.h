#pragma once

#include <Eigen/Core>
#include <array>
#include <functional>
#include <span>
#include <vector>

#include "controller/law/law.h"
#include "experiment/scenario.h"
#include "loop/measurements.h"

/// A scenario's law for analysis: as functions of vectors, and the Lyapunov function that it
/// declares. Here, beside the registry, each law is compiled once for all uses.
namespace tachless::controller {

/// One after the other; null: none.
Eigen::VectorXd packed(std::span<robot::Vector* const> vectors);
/// The reverse; the vectors have their sizes.
void unpack(const Eigen::VectorXd& from, std::span<robot::Vector* const> vectors);

/// The parts of a measurement from the plant's state, by `loop::Part`; null: not measured.
/// @return the parts that are not empty, as motors of a rigid robot are
std::vector<loop::Part> measure(const std::array<robot::Vector, 4>& state,
                                std::span<robot::Vector* const> parts);

/// A law as a function, its reference held, as vectors of numbers: memory and measurement at rest
/// there, and the memory with which it starts from a measurement.
struct SteppedLaw {
  law::LawStep step;
  std::function<Eigen::VectorXd(const Eigen::VectorXd&)> start;
  Eigen::VectorXd memory, measurement;
  std::vector<loop::Part> measured;
};

/// @param state the plant's on that reference, by `loop::Part`
/// @return without functions when `LawFacts::no_linearisation` says why
/// @throw diagnostics::Failure(bad_usage) as `scenario_law`
SteppedLaw stepped_law(const experiment::Scenario& scenario, const loop::ReferencePoint& reference,
                       const std::array<robot::Vector, 4>& state);

/// The Lyapunov function by which a law's stability is proved, of a state of the loop [J].
using LyapunovFunction = std::function<double(const law::LoopState&, const loop::ReferencePoint&)>;

/// That of the scenario's law, with the model that the law is given (a payload unknown to it is
/// not in M). Empty when the law declares none.
/// @param weights of its cross terms, where it has some: those of `certificate::certified_run`
/// @throw diagnostics::Failure(bad_usage) when the law cannot be made of the scenario.
LyapunovFunction lyapunov_function(const experiment::Scenario& scenario,
                                   const law::LyapunovWeights& weights = {});

}  // namespace tachless::controller
