#include "tests/soak/observer.h"

#include <unistd.h>

#include <algorithm>
#include <span>
#include <vector>

#include "bus/authenticated.h"
#include "node/options.h"
#include "process/process_tree.h"
#include "tests/support/process_facts.h"

namespace tachless::soak {

Observer::Observer(const Spec& spec, HostileTraffic* traffic)
    : spec_(spec),
      traffic_(traffic),
      tick_channel_(loop::channel<loop::Tick>(spec.scenario.robot.channel_prefix)),
      codec_(loop::Layout{}),
      bus_(node::default_lcm_url) {
  if (traffic_ != nullptr) {
    bus_.subscribe_all();
  } else {
    bus_.subscribe(tick_channel_);
  }
}

void Observer::look_at_processes() {
  if (!launcher_) {
    const std::vector<pid_t> own = process::children_of(getpid());
    if (own.empty()) return;
    launcher_ = own.front();
  }
  processes_.clear();
  for (const pid_t pid : process::children_of(*launcher_)) {
    const std::string program = support::program_of(pid);
    if (program.starts_with("tachless-")) processes_[program] = pid;
  }
  if (!processes_.empty()) {
    gone_since_.reset();
  } else if (!first_pids_.empty() && !gone_since_) {
    gone_since_ = Clock::now();
  }
  for (const auto& [program, pid] : processes_) first_pids_.try_emplace(program, pid);
  if (tick_ < spec_.scenario.loop.num_ticks / 10) return;
  for (const auto& [program, pid] : processes_) {
    const auto kib = support::resident_kib(pid);
    if (!kib || first_pids_.at(program) != pid) continue;
    Memory& memory = memory_[program];
    if (memory.early == 0) memory.early = *kib;
    memory.peak = std::max(memory.peak, *kib);
  }
}

void Observer::listen() {
  while (const auto datagram = bus_.receive(Clock::time_point::min())) take(*datagram);
}

void Observer::take(const bus::Datagram& datagram) {
  if (traffic_ != nullptr) {
    // `run` tries the network on channels of its own before the run.
    const bool of_run = datagram.channel.starts_with(spec_.scenario.robot.channel_prefix + "_");
    if (!of_run || traffic_->is(datagram.sender)) return;
    traffic_->add_sample(datagram.channel, datagram.payload);
  }
  if (datagram.channel != tick_channel_) return;
  loop::Stamp stamp;
  loop::Tick tick;
  std::span<const std::byte> payload = datagram.payload;
  if (spec_.round.fault == Fault::key && payload.size() > bus::tag_size) {
    payload = payload.first(payload.size() - bus::tag_size);
  }
  if (codec_.decode(payload, stamp, tick) != bus::Rejection::none) return;
  tick_ = stamp.tick;
  last_ = last_ || tick.last;
  if (traffic_ != nullptr) traffic_->now_at(tick_);
}

std::optional<pid_t> Observer::process_of(loop::Role role) const {
  const auto found = processes_.find(node::program_name(role));
  if (found == processes_.end()) return std::nullopt;
  return found->second;
}

}  // namespace tachless::soak
