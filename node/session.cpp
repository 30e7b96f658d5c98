#include "node/session.h"

#include <fmt/core.h>

#include <algorithm>
#include <exception>

#include "diagnostics/current_failure.h"
#include "diagnostics/logging.h"
#include "diagnostics/time.h"
#include "protocol/membership.h"

namespace tachless::node {

using diagnostics::ExitCode;
using diagnostics::Failure;
using diagnostics::seconds_of;
using loop::Clock;
using protocol::lockstep::Verdict;

void Session::guard(const std::function<void()>& main) {
  try {
    main();
  } catch (const std::exception&) {
    fail(diagnostics::current_failure());
    throw;
  } catch (...) {  // a main catches std::exception only
    const Failure failure = diagnostics::current_failure();
    fail(failure);
    throw Failure(failure);
  }
}

void Session::fail(const Failure& failure) {
  statistics_.exit_code = failure.code();
  statistics_.fault = failure.what();
  note_end(Clock::now());
  try {
    announce_fault(failure);
  } catch (const std::exception& problem) {
    // `failure` came first and is the one to report.
    diagnostics::log_warning("the others cannot be informed of it: {}", problem.what());
  }
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
  if (started_at_ != Clock::time_point()) statistics_.wall_s = seconds_of(now - started_at_);
}

void Session::throw_if_interrupted() const {
  if (interrupted_ != nullptr && *interrupted_) throw Failure(ExitCode::interrupted, "interrupted");
}

void Session::on(const std::string& channel, Handler handler) {
  transport_.subscribe(channel);
  diagnostics::log_detail("receives {}", channel);
  handlers_.emplace_back(channel, std::move(handler));
}

void Session::run_until(const std::function<bool()>& done, const Turn& turn) {
  while (!done()) {
    const Time now = Clock::now();
    poll(now);
    const Time due = turn ? turn(now) : Time::max();
    receive(std::min(due, next_poll()));
  }
}

void Session::run_until_finished(const std::function<bool(Time)>& all_there, const Turn& turn) {
  run_until([this] { return finished(); },
            [&](Time now) {
              if (all_there(now)) complete();
              return turn ? turn(now) : Time::max();
            });
}

bool Session::receive(Time deadline) {
  const auto datagram = transport_.receive(deadline);
  if (!datagram) return false;
  const Handled handled = handle(*datagram);
  if (handled == Handled::believed && session_handler_) session_handler_(*datagram);
  if (handled != Handled::no) return true;
  for (const auto& [channel, handler] : handlers_) {
    if (channel != datagram->channel) continue;
    handler(*datagram);
    break;
  }
  return true;
}

void Session::count(Verdict verdict) {
  if (verdict == Verdict::repeated) ++statistics_.duplicates;
  if (verdict == Verdict::not_asked) statistics_.rejected.add(Discard::not_asked);
  if (verdict == Verdict::too_old) statistics_.rejected.add(Discard::too_old);
}

Failure Session::two_of(loop::Role role, const bus::Datagram& second, std::int64_t tick,
                        std::string_view first) const {
  return {ExitCode::protocol_violated,
          "two processes are the {} of run {}: {} and {} sent different {} messages for tick {}; "
          "the run's own is {}, end the other",
          loop::name(role),
          run(),
          first,
          second.sender,
          second.channel,
          tick,
          describe(role)};
}

Playback::Playback(const experiment::Scenario& scenario, bus::Transport& transport,
                   std::int64_t run, double wait_s, const std::atomic<bool>* interrupted)
    : Session(loop::Role::controller, transport, {}, interrupted),
      run_(run),
      last_tick_(scenario.loop.num_ticks - 1),
      wait_s_(wait_s),
      give_up_s_(scenario.loop.give_up_s) {}

void Playback::join(const loop::LawInfo& /*law*/, const Handler& /*other*/) {
  progress_at_ = next_poll_ = Clock::now();
  statistics().run_id = run_;
  diagnostics::log_info("following run {} as it is played back", run_);
}

void Playback::progressed(std::int64_t tick, double /*error_norm*/) {
  tick_ = tick;
  progress_at_ = Clock::now();
}

void Playback::poll(Clock::time_point now) {
  throw_if_interrupted();
  next_poll_ = now + protocol::Membership::period;
  const bool begun = tick_ >= 0;
  if (!begun && wait_s_ == 0) return;
  if (now - progress_at_ < diagnostics::nanoseconds_of(begun ? give_up_s_ : wait_s_)) return;
  if (!begun) {
    throw Failure(ExitCode::peer_lost,
                  "no measurement of run {} with its reference came; is that the run's id? "
                  "`tachless info LOG` tells",
                  run_);
  }
  throw Failure(ExitCode::peer_lost,
                "run {} goes silent after tick {} of {}: a measurement or reference is missing; "
                "`tachless info LOG` names the gaps",
                run_, tick_, last_tick_);
}

std::string Playback::describe(loop::Role role) const {
  return fmt::format("the {}", loop::name(role));
}

}  // namespace tachless::node
