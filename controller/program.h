#pragma once

#include "controller/registry.h"

/// A controller program with a user's own law. It takes the options of tachless-controller and
/// joins the run on the bus. It logs, counts and is replayed like tachless-controller.
namespace tachless {

/// Runs the law that `make_law` makes from the scenario, whose controller.law has to be `external`.
/// @return the exit code for main
int run_controller(int argc, const char* const* argv, const controller::MakeLaw& make_law);

/// Runs the law L, a class as controller/law/law.h describes it. Its parameters are the scenario's
/// controller.gains.
/// @return the exit code for main
template <controller::law::Law L>
int run_controller(int argc, const char* const* argv) {
  static const controller::LawFacts facts = controller::facts_of<L>();
  return run_controller(argc, argv, [](const scenario::Scenario& scenario) {
    return controller::law_over_run<L>(scenario, facts);
  });
}

namespace controller {

/// Runs a controller program with the laws of `make_law`.
/// @return the exit code for main
int run_program(int argc, const char* const* argv, const MakeLaw& make_law);

}  // namespace controller
}  // namespace tachless
