#include "logger/lockstep_recorder.h"

#include <stdexcept>

namespace tachless::logger {

using loop::Clock;
using protocol::lockstep::Verdict;

LockstepRecorder::LockstepRecorder(const experiment::Scenario& scenario, bus::Transport& transport,
                                   node::Link& link, const std::filesystem::path& log_path)
    : Recorder(scenario, transport, link, log_path),
      window_(scenario.loop.num_ticks, messages().longest()) {}

void LockstepRecorder::on_message(Slot slot, const loop::Stamp& stamp,
                                  const bus::Datagram& datagram) {
  const Verdict verdict = window_.on_message(slot, stamp.tick, datagram.payload, datagram.sender);
  count(verdict, role_of(slot), datagram, stamp.tick,
        [&] { return window_.sender(stamp.tick, slot); });
}

void LockstepRecorder::after_message() {
  write_complete_ticks();
  if (const auto ack = window_.take_ack()) acknowledge(ack->tick, ack->missing);
}

void LockstepRecorder::write_complete_ticks() {
  while (const auto tick = window_.complete_tick()) {
    const auto begin = Clock::now();
    loop::Stamp stamp;
    if (messages().check(Slot::tick, window_.bytes(*tick, Slot::tick), stamp) !=
        bus::Rejection::none) {
      throw std::logic_error("a kept message has changed");
    }
    for (int slot = 0; slot < loop::num_slots; ++slot) {
      append(stamp.utime, messages().channel(static_cast<Slot>(slot)),
             window_.bytes(*tick, static_cast<Slot>(slot)));
    }
    truth_digest_.add(window_.bytes(*tick, Slot::truth));
    utime_ = stamp.utime;
    window_.written();
    link().progressed(*tick);
    link().statistics().ticks = *tick + 1;
    link().statistics().logger().log.ticks = *tick + 1;
    link().statistics().work_us.add(Clock::now() - begin);
  }
}

/// A stranger's TRUTH contradicts the plant's own, and is noticed by that, unless that one is lost.
void LockstepRecorder::compare_truth() {
  if (link().membership().truth_digest() == truth_digest_.value()) return;
  throw diagnostics::Failure(diagnostics::ExitCode::protocol_violated,
                             "what is recorded on " + messages().channel(Slot::truth) +
                                 " is not what " + link().describe(loop::Role::plant) +
                                 " has published: somebody else has published there too; find it "
                                 "with `tachless watch`, or use a key (--key-file)");
}

void LockstepRecorder::conclude(bool well) {
  if (well) return compare_truth();  // every tick is written
  constexpr int most = 10'000;       // a flood of datagrams must not keep this process from its end
  for (int i = 0; i < most && loop().receive(Clock::time_point()); ++i) {
  }
}

}  // namespace tachless::logger
