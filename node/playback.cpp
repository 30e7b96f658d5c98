#include "node/playback.h"

#include <fmt/core.h>

#include "diagnostics/logging.h"
#include "diagnostics/time.h"
#include "protocol/membership.h"

namespace tachless::node {
namespace {

using diagnostics::ExitCode;
using diagnostics::Failure;
using loop::Clock;

}  // namespace

Playback::Playback(const experiment::Scenario& scenario, const Config& config)
    : Session(loop::Role::controller, config.interrupted),
      run_(config.run),
      last_tick_(scenario.loop.num_ticks - 1),
      give_up_(diagnostics::nanoseconds_of(scenario.loop.give_up_s)) {
  if (config.wait_s > 0) wait_ = diagnostics::nanoseconds_of(config.wait_s);
}

void Playback::join(const loop::LawInfo& /*law*/, const Handler& /*other*/) {
  progress_at_ = next_poll_ = Clock::now();
  statistics().run_id = run_;
  diagnostics::log_info("following run {} as it is played back", run_);
}

void Playback::started(Clock::time_point now) {
  if (tick_ < 0) note_start(now);
}

void Playback::progressed(std::int64_t tick, double /*error_norm*/) {
  tick_ = tick;
  progress_at_ = Clock::now();
}

void Playback::poll(Clock::time_point now) {
  throw_if_interrupted();
  next_poll_ = now + protocol::Membership::period;
  const bool begun = tick_ >= 0;
  const auto limit = begun ? std::optional(give_up_) : wait_;
  if (!limit || now - progress_at_ < *limit) return;
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
