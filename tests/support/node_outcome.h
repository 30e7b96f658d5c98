#pragma once

#include <exception>
#include <functional>
#include <string>

#include "base/failure.h"
#include "session/session.h"

namespace tachless::support {

/// How a node ended.
struct NodeOutcome {
  base::ExitCode code = base::ExitCode::done;
  std::string fault;
  session::Statistics statistics;
};

/// Runs a node's whole life in a session.
inline NodeOutcome outcome_of(session::Session& session, const std::function<void()>& node) {
  NodeOutcome outcome;
  try {
    session.guard(node);
  } catch (const base::Failure& failure) {
    outcome.code = failure.code();
    outcome.fault = failure.what();
  } catch (const std::exception& error) {
    outcome.code = base::ExitCode::protocol_violated;
    outcome.fault = std::string("internal error: ") + error.what();
  }
  outcome.statistics = session.statistics();
  return outcome;
}

}  // namespace tachless::support
