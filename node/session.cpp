#include "node/session.h"

#include <chrono>
#include <exception>

namespace tachless::node {

using diagnostics::ExitCode;
using diagnostics::Failure;
using loop::Clock;

void Session::guard(const std::function<void()>& main) {
  try {
    main();
  } catch (const Failure& failure) {
    fail(failure);
    throw;
  } catch (const std::exception& error) {
    fail(Failure(ExitCode::protocol_violated, error.what()));
    throw;
  }
}

void Session::fail(const Failure& failure) {
  statistics_.exit_code = failure.code();
  statistics_.fault = failure.what();
  note_end(Clock::now());
  announce_fault(failure);
}

bool Session::accept(bus::Rejection rejection, const loop::Stamp& stamp) {
  if (rejection != bus::Rejection::none) {
    statistics_.rejected.add(rejection);
  } else if (stamp.run != run()) {
    statistics_.rejected.add(Discard::other_run);
  } else {
    return true;
  }
  return false;
}

void Session::note_end(Clock::time_point now) {
  if (started_at_ == Clock::time_point()) return;
  statistics_.wall_s = std::chrono::duration<double>(now - started_at_).count();
}

void Session::throw_if_interrupted() const {
  if (interrupted_ != nullptr && *interrupted_) throw Failure(ExitCode::interrupted, "interrupted");
}

}  // namespace tachless::node
