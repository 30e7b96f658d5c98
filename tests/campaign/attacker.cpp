#include "tests/campaign/attacker.h"

#include <algorithm>
#include <chrono>
#include <utility>

#include "base/failure.h"

namespace tachless::campaign {

using namespace std::chrono_literals;
using base::Clock;

void Lies::note(std::span<const std::byte> payload) {
  if (payload.size() < messages::stamp_end) return;
  const std::lock_guard lock(mutex_);
  ticks_.insert(messages::stamp_of(payload).tick);
}

std::set<std::int64_t> Lies::ticks() const {
  const std::lock_guard lock(mutex_);
  return ticks_;
}

Attacker::Attacker(std::unique_ptr<bus::Transport> endpoint, const std::optional<Hostility>& plan,
                   std::uint64_t seed, const std::vector<Sent>& recording, Lies& lies,
                   std::function<void(std::size_t)> on_received)
    : endpoint_(std::move(endpoint)),
      plan_(plan),
      random_(seed),
      forger_(seed),
      recording_(recording),
      lies_(lies),
      on_received_(std::move(on_received)) {
  for (const auto* suffix : {"TICK", "POSITION", "REFERENCE", "COMMAND", "CONTROLLER_STATE",
                             "TRUTH", "RUN_INFO", "LOG_ACK", "PARTICIPANT"}) {
    endpoint_->subscribe(std::string("ARM_") + suffix);
  }
  thread_ = std::thread([this] { listen(); });
}

void Attacker::stop() {
  stop_ = true;
  if (thread_.joinable()) thread_.join();
}

void Attacker::listen() {
  while (!stop_) {
    const auto datagram = endpoint_->receive(Clock::now() + 5ms);
    if (!datagram) continue;
    received_.push_back(
        {std::string(datagram->channel), {datagram->payload.begin(), datagram->payload.end()}});
    if (on_received_) on_received_(received_.size());
    if (plan_ && plan_->acknowledges) acknowledge();
    if (!plan_ || received_.size() <= static_cast<std::size_t>(plan_->from)) continue;
    if (chance(plan_->rate)) act();
  }
}

/// Acknowledges the newest tick if its TRUTH, the tick's last message, was received.
void Attacker::acknowledge() {
  if (received_.back().channel != "ARM_TRUTH") return;
  const messages::Stamp stamp = messages::stamp_of(received_.back().payload);
  endpoint_->publish("ARM_LOG_ACK", acks_.encode(stamp, messages::LogAck{}));
  ++num_sent_;
}

/// Returns mostly the newest message, else an earlier one or a recorded one.
const Sent& Attacker::pick() {
  const auto draw = below(10);
  if (draw == 0 && !recording_.empty()) return recording_[below(recording_.size())];
  return draw < 3 ? received_[below(received_.size())] : received_.back();
}

void Attacker::act() {
  if (plan_->replays) {
    const Sent& old = received_[below(received_.size())];
    for (auto copies = 1 + below(3); copies > 0; --copies) send(old.channel, old.payload);
  }
  if (plan_->recordings && !recording_.empty()) {
    // Half of the copies come in the order of the earlier run, the others in any order.
    for (int i = 0; i < 4; ++i) {
      const std::size_t next = below(2) == 0 ? replayed_++ : below(recording_.size());
      const Sent& old = recording_[next % recording_.size()];
      send(old.channel, old.payload);
    }
  }
  const Sent honest = pick();
  if (plan_->forges) lie(honest, forger_.forge(honest));
  if (plan_->damages) lie(honest, forger_.damage(honest));
  if (plan_->contradicts) lie(honest, forger_.contradict(honest));
  if (plan_->names) lie(honest, forger_.name(honest));
  if (plan_->announces) announce();
  if (plan_->floods) flood();
}

void Attacker::send(std::string_view channel, std::span<const std::byte> payload) {
  endpoint_->publish(channel, payload);
  ++num_sent_;
}

void Attacker::lie(const Sent& honest, const std::vector<std::byte>& payload) {
  lies_.note(payload);
  send(honest.channel, payload);
}

/// Sends the newest announcement and one of an earlier session: unchanged copies, and newer ones
/// with other contents.
void Attacker::announce() {
  const auto is_announcement = [](const Sent& each) { return each.channel == "ARM_PARTICIPANT"; };
  const auto newest = std::find_if(received_.rbegin(), received_.rend(), is_announcement);
  if (newest != received_.rend()) {
    const Sent honest = *newest;
    send(honest.channel, honest.payload);
    lie(honest, below(2) == 0 ? forger_.forge(honest) : forger_.contradict(honest));
  }
  if (recording_.empty()) return;
  const auto from = recording_.begin() + static_cast<std::ptrdiff_t>(below(recording_.size()));
  const auto earlier = std::find_if(from, recording_.end(), is_announcement);
  if (earlier == recording_.end()) return;
  send(earlier->channel, earlier->payload);
  lie(*earlier, forger_.forge(*earlier));
}

void Attacker::flood() {
  for (int i = 0; i < 100 && flooded_ < flood_bytes; ++i) {
    const auto bytes = forger_.garbage();
    flooded_ += bytes.size();
    send(received_[below(received_.size())].channel, bytes);
  }
}

void Raced::publish(std::string_view channel, std::span<const std::byte> payload) {
  const auto chance = [this](double probability) {
    return static_cast<double>(random_() >> 11) * 0x1p-53 < probability;
  };
  if (!chance(plan_.races)) return Wrapped::publish(channel, payload);
  const Sent honest{std::string(channel), {payload.begin(), payload.end()}};
  const auto lie = chance(0.5) ? forger_.contradict(honest) : forger_.forge(honest);
  lies_.note(lie);
  rival_->publish(channel, lie);
  if (!chance(plan_.drops)) Wrapped::publish(channel, payload);
}

void Afflicted::count() {
  if (++count_ != mishap_.at + 1) return;
  happened_ = true;
  if (mishap_.kind == Mishap::Kind::stop) {
    std::this_thread::sleep_for(std::chrono::milliseconds(mishap_.stop_ms));
  }
  if (mishap_.kind == Mishap::Kind::interrupt) interrupt_();
}

void Afflicted::throw_if_failing() const {
  if (!happened_ || mishap_.kind != Mishap::Kind::fail) return;
  throw base::Failure(base::ExitCode::peer_lost, "the bus fails");
}

void Afflicted::publish(std::string_view channel, std::span<const std::byte> payload) {
  count();
  throw_if_failing();
  if (!dead()) Wrapped::publish(channel, payload);
}

std::optional<bus::Datagram> Afflicted::receive(Clock::time_point deadline) {
  throw_if_failing();
  auto datagram = Wrapped::receive(deadline);
  if (datagram) count();
  return dead() ? std::nullopt : datagram;
}

}  // namespace tachless::campaign
