#pragma once

#include "controller/registry.h"

/// A whole controller program with a law of one's own: it takes the options of tachless-controller,
/// joins the run on the bus, logs, counts and is replayed as that one does.
namespace tachless {

/// Runs the law that `make_law` makes of the scenario, whose controller.law has to be `external`.
/// To be returned from main.
int run_controller(int argc, const char* const* argv, const controller::MakeLaw& make_law);

/// The same with the law L, a class as controller/law/law.h describes it; its parameters are the
/// scenario's controller.gains.
template <controller::law::Law L>
int run_controller(int argc, const char* const* argv) {
  static const controller::LawFacts facts = controller::facts_of<L>();
  return run_controller(argc, argv, [](const scenario::Scenario& scenario) {
    return controller::law_over_run<L>(scenario, facts);
  });
}

namespace controller {

/// The main of a controller program, whatever its laws.
int run_program(int argc, const char* const* argv, const MakeLaw& make_law);

}  // namespace controller
}  // namespace tachless
