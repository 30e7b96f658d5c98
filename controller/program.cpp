#include "controller/program.h"

#include <fmt/core.h>

#include <tuple>

#include "controller/law_socket.h"
#include "controller/node.h"
#include "node/options.h"
#include "node/run_role.h"

namespace tachless {

int run_controller(int argc, const char* const* argv, const controller::MakeLaw& make_law) {
  return controller::run_program(argc, argv, [&](const experiment::Scenario& scenario) {
    const auto& [law, measurement] =
        std::tie(scenario.controller.law, scenario.controller.measurement);
    if (law != experiment::external_law) {
      throw scenario.complaint("controller.law",
                               fmt::format("{}, which this program does not compute; write {}, or "
                                           "start it with: tachless run SCENARIO --controller",
                                           law, experiment::external_law));
    }
    controller::ScenarioLaw made = make_law(scenario);
    const loop::LawInfo info = controller::law_info(*made);
    if (info.measurement != measurement) {
      throw scenario.complaint("controller.measurement",
                               fmt::format("{}, but the law {} of this program needs {}",
                                           measurement, info.law, info.measurement));
    }
    if (info.law.size() > loop::max_participant_text) {
      throw diagnostics::bad_usage("the law's name has {} characters; allowed: {}", info.law.size(),
                                   loop::max_participant_text);
    }
    return made;
  });
}

int controller::run_program(int argc, const char* const* argv, const MakeLaw& make_law) {
  constexpr auto role = loop::Role::controller;
  return node::run_process(role, argc, argv, [&](const node::ProcessOptions& options) {
    if (options.serve) {
      serve_law(*options.serve, make_law);
      return diagnostics::ExitCode::done;
    }
    return node::run_role(role, options,
                          [&](const experiment::Scenario& scenario, node::Link& link) {
                            run_node(scenario, make_law(scenario), link);
                          });
  });
}

}  // namespace tachless
