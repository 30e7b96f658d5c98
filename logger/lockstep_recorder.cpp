#include "logger/lockstep_recorder.h"

#include <stdexcept>

namespace tachless::logger {

using loop::Clock;
using protocol::lockstep::Verdict;

LockstepRecorder::LockstepRecorder(const experiment::Scenario& scenario, bus::Transport& transport,
                                   node::Session& session, const std::filesystem::path& log_path)
    : Recorder(scenario, transport, session, log_path),
      window_(scenario.loop.num_ticks, messages().longest()),
      participant_codec_(loop::Layout{}) {}

void LockstepRecorder::on_message(Slot slot, const loop::Stamp& stamp,
                                  const bus::Datagram& datagram) {
  const Verdict verdict = window_.on_message(slot, stamp.tick, datagram.payload, datagram.sender);
  const bool contradicts = verdict == Verdict::conflicting;
  count(verdict, slot, stamp.tick, contradicts ? window_.sender(stamp.tick, slot) : "",
        datagram.sender);
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
    utime_ = stamp.utime;
    window_.written();
    session().progressed(*tick);
    session().statistics().ticks = *tick + 1;
    session().statistics().log->ticks = *tick + 1;
    session().statistics().work.add(Clock::now() - begin);
  }
}

void LockstepRecorder::on_participant(const bus::Datagram& datagram) {
  loop::Stamp stamp;
  loop::Participant who;
  // The last one before the session ends is the one it ends for; others' follow from that.
  if (concluding_ ||
      participant_codec_.decode(datagram.payload, stamp, who) != bus::Rejection::none ||
      stamp.run != session().run() || who.state != loop::ParticipantState::fault) {
    return;
  }
  fault_channel_ = datagram.channel;
  fault_.assign(datagram.payload.begin(), datagram.payload.end());
}

void LockstepRecorder::conclude(bool well) {
  if (well) return;  // the plant has finished, and so has everything it waited for
  concluding_ = true;
  constexpr int most = 10'000;  // whoever floods the bus must not keep us here
  for (int i = 0; i < most && receive(Clock::time_point()); ++i) {
  }
  if (!fault_.empty()) append(utime_, fault_channel_, fault_);
}

}  // namespace tachless::logger
