#include "controller/program.h"

#include <fmt/core.h>

#include <tuple>

#include "controller/law_socket.h"
#include "controller/node.h"
#include "session/options.h"
#include "session/run_role.h"

namespace tachless {

int run_controller(int argc, const char* const* argv, const controller::MakeLaw& make_law) {
  return controller::run_program(argc, argv, [&](const scenario::Scenario& scenario) {
    const auto& [law, measurement] =
        std::tie(scenario.controller.law, scenario.controller.measurement);
    if (law != controller::external_law_name) {
      throw scenario.complaint("controller.law",
                               fmt::format("{}, which this program does not compute; write {}, or "
                                           "start it with: tachless run SCENARIO --controller",
                                           law, controller::external_law_name));
    }
    controller::ScenarioLaw made = make_law(scenario);
    const messages::LawInfo info = controller::law_info(*made);
    if (info.measurement != measurement) {
      throw scenario.complaint("controller.measurement",
                               fmt::format("{}, but the law {} of this program needs {}",
                                           measurement, info.law, info.measurement));
    }
    if (info.law.size() > messages::max_participant_text) {
      throw base::bad_usage("the law's name has {} characters; allowed: {}", info.law.size(),
                            messages::max_participant_text);
    }
    return made;
  });
}

int controller::run_program(int argc, const char* const* argv, const MakeLaw& make_law) {
  constexpr auto role = messages::Role::controller;
  return session::run_process(role, argc, argv, [&](const session::ProcessOptions& options) {
    if (options.serve) {
      serve_law(*options.serve, make_law);
      return base::ExitCode::done;
    }
    return session::run_role(role, options,
                             [&](const scenario::Scenario& scenario, session::Session& session) {
                               run_node(scenario, make_law(scenario), session);
                             });
  });
}

}  // namespace tachless
