#include "viewer/truth_listener.h"

namespace tachless::viewer {

TruthListener::TruthListener(const bus::LcmUrl& url, const std::optional<bus::Key>& key,
                             const experiment::Scenario& scenario, std::int64_t run)
    : transport_(bus::open_bus(url)),
      truth_channel_(loop::channel<loop::truth::PlantTruth>(scenario.robot.channel_prefix)),
      truth_codec_({scenario.num_joints, scenario.robot.flexible ? scenario.num_joints : 0, 0}),
      participant_codec_(loop::Layout{}),
      period_s_(scenario.loop.period_s),
      run_(run) {
  transport_->subscribe(truth_channel_);
  if (!key) return;
  authenticated_.emplace(*transport_, *key);
  transport_->subscribe(loop::channel<loop::Participant>(scenario.robot.channel_prefix));
}

void TruthListener::drain(const std::function<void(double t_s, const robot::Vector& q)>& on_pose) {
  bus::Transport& heard =
      authenticated_ ? static_cast<bus::Transport&>(*authenticated_) : *transport_;
  while (const auto datagram = heard.receive(loop::Clock::time_point{})) {
    if (datagram->channel != truth_channel_) {
      note_plant(*datagram);
    } else if (truth_codec_.decode(datagram->payload, stamp_, truth_) == bus::Rejection::none) {
      if (run_ == 0) run_ = stamp_.run;
      if (stamp_.run == run_) on_pose(static_cast<double>(stamp_.tick) * period_s_, truth_.q);
    }
  }
}

// On a bus with a key, truth verifies under one that is derived for the session besides.
void TruthListener::note_plant(const bus::Datagram& datagram) {
  loop::Stamp stamp;
  loop::Participant participant;
  if (participant_codec_.decode(datagram.payload, stamp, participant) != bus::Rejection::none ||
      participant.role != loop::Role::plant || participant.roster == roster_ ||
      participant.roster == loop::PerRole{} || (run_ != 0 && stamp.run != run_)) {
    return;
  }
  roster_ = participant.roster;
  authenticated_->enter(stamp.run, roster_);
}

}  // namespace tachless::viewer
