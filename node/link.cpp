#include "node/link.h"

#include <fmt/core.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <random>
#include <vector>

#include "diagnostics/logging.h"
#include "diagnostics/text.h"
#include "diagnostics/time.h"

namespace tachless::node {
namespace {

using namespace std::chrono_literals;
using diagnostics::Failure;
using loop::Clock;
using loop::Role;
using protocol::Membership;

constexpr auto first_notice = 1s;
constexpr auto notice_period = 5s;
constexpr auto leaving_period = 20ms;
constexpr auto longest_leaving = 1s;
// A last announcement that nobody waits for is repeated, some time apart: packets are lost in
// bursts.
constexpr int last_announcements = 5;
constexpr auto last_announcements_period = 5ms;

std::int64_t random_instance() {
  std::random_device device;
  const std::uint64_t high = device();
  return static_cast<std::int64_t>((high << 32 | device()) >> 1) | 1;
}

std::string host_name() {
  std::array<char, 256> name{};
  return gethostname(name.data(), name.size() - 1) == 0 ? name.data() : "";
}

Membership::Self self_of(const experiment::Scenario& scenario, const Link::Config& config) {
  Membership::Self self;
  self.who.role = config.role;
  self.who.instance = config.instance != 0 ? config.instance : random_instance();
  self.who.scenario_digest = scenario.digest;
  self.who.pid = static_cast<std::int32_t>(getpid());
  self.who.host = host_name();
  self.who.scenario = scenario.name.substr(0, loop::max_participant_text);
  const auto since_1970 = std::chrono::system_clock::now().time_since_epoch();
  if (config.role == Role::plant) self.run = config.run_id.value_or(since_1970 / 1us);
  if (config.wait_s > 0) self.wait_limit = diagnostics::nanoseconds_of(config.wait_s);
  self.give_up = diagnostics::nanoseconds_of(scenario.loop.give_up_s);
  self.takeover = scenario.loop.mode == experiment::Mode::lockstep;
  self.resumes = config.resume;
  return self;
}

}  // namespace

void KeyCheck::foreign(const bus::Stranger& stranger, Clock::time_point now) {
  if (num_foreign_++ > 0) return;
  since_ = now;
  const std::string_view own = loop::name(own_role_);
  std::string difference = fmt::format("has no key, this {}", own);
  if (stranger.tagged) {
    difference = fmt::format("has {} key{} this {}", has_key_ ? "another" : "a",
                             has_key_ ? " than" : ",", own);
  }
  first_ = fmt::format("{} {}{}", protocol::describe(stranger.who, stranger.sender), difference,
                       has_key_ ? "" : " has none");
}

void KeyCheck::poll(Clock::time_point now) const {
  // No announcement that verifies among so many for so long: the keys differ.
  if (accepted_ || num_foreign_ < 5 || now - since_ < 1500ms) return;
  throw Failure(diagnostics::ExitCode::protocol_violated,
                "{}; give all four programs the same --key-file (or TACHLESS_KEY_FILE)", first_);
}

Link::Link(const experiment::Scenario& scenario, bus::Transport& transport, const Config& config)
    : Session(config.role, transport, config.key, config.interrupted),
      channel_(loop::channel<loop::Participant>(scenario.robot.channel_prefix)),
      self_(self_of(scenario, config)),
      codec_(loop::Layout{}),
      key_check_(config.role, config.key.has_value()) {
  membership_.emplace(self_, Clock::now());
  transport_.subscribe(channel_);
}

void Link::join(const loop::LawInfo& law, const Handler& other) {
  const auto begin = Clock::now();
  self_.who.law = law.name;
  self_.who.measurement = law.measurement;
  self_.who.signals = law.signals;
  membership_.emplace(self_, begin);
  next_notice_ = begin + first_notice;
  while (!membership_->joined()) {
    poll(Clock::now());
    const auto datagram = transport_.receive(next_poll());
    if (datagram && handle(*datagram) == Handled::no && other) other(*datagram);
    const auto now = Clock::now();
    if (const auto stranger = transport_.take_stranger()) key_check_.foreign(*stranger, now);
    key_check_.poll(now);
  }
  // Membership fails when the predecessor is heard: it is still there.
  const auto until = Clock::now() + (self_.resumes ? Membership::takeover_after : 0ms);
  for (auto now = Clock::now(); now < until; now = Clock::now()) {
    poll(now);
    if (const auto datagram = transport_.receive(std::min(until, next_poll()))) handle(*datagram);
  }
  statistics().run_id = run();
  std::vector<std::string> others;
  for (const Role role : {Role::plant, Role::reference, Role::controller, Role::logger}) {
    if (role != self_.who.role) others.push_back(describe(role));
  }
  diagnostics::log_detail("run {} on {}, with {}", run(), channel_, diagnostics::joined(others));
}

void Link::handle_pending() {
  while (const auto datagram = transport_.receive(Clock::time_point())) handle(*datagram);
  poll(Clock::now());
}

void Link::started(Clock::time_point now) {
  if (membership_->running()) return;
  membership_->started(now);
  note_start(now);
}

void Link::poll(Clock::time_point now) {
  throw_if_interrupted();
  if (now >= next_poll()) {
    membership_->poll(now);
    if (!membership_->failure()) announce(now);
    if (!membership_->running() && now >= next_notice_) tell_who_is_missing(now);
  }
  if (membership_->failure()) throw Failure(*membership_->failure());
}

Link::Handled Link::handle(const bus::Datagram& datagram) {
  if (datagram.channel != channel_) return Handled::no;
  const bus::Rejection rejection = codec_.decode(datagram.payload, stamp_, peer_);
  if (rejection != bus::Rejection::none) {
    statistics().rejected.add(rejection);
    return Handled::dropped;
  }
  const bool believed = membership_->handle(stamp_, peer_, datagram.sender, Clock::now());
  key_check_.accepted();
  if (membership_->joined() && membership_->roster() != entered_) {
    entered_ = membership_->roster();
    transport_.enter(run(), entered_);
  }
  return believed ? Handled::believed : Handled::dropped;
}

std::span<const std::byte> Link::announce(Clock::time_point now) {
  const auto& announcement = membership_->announce(now);
  const auto bytes = codec_.encode(announcement.stamp, announcement.participant);
  transport_.publish(channel_, bytes);
  return bytes;
}

std::span<const std::byte> Link::ending(const Failure& failure) {
  const auto now = Clock::now();
  membership_->failed(failure, now);
  return announce(now);
}

void Link::stopping(const Failure& failure, Clock::time_point now) {
  membership_->stopping(failure, now);
  announce(now);
}

void Link::announce_repeatedly() {
  // Who was busy for long has answered announcements that are too old to count: first what waits.
  announce(Clock::now());
  const auto until_heard = Clock::now() + longest_leaving;
  while (Clock::now() < until_heard) {
    const auto datagram = transport_.receive(Clock::time_point());
    if (!datagram) break;
    handle(*datagram);
  }
  // Before a run, so long that who was started at the same time can meet this process, and hear
  // why.
  const auto until = Clock::now() + (membership_->joined() ? 0ms : Membership::simultaneous);
  for (int i = 0; i < last_announcements || Clock::now() < until; ++i) {
    announce(Clock::now());
    handle_until(Clock::now() + last_announcements_period, [] { return false; });
  }
}

void Link::announce_fault(const Failure& failure) {
  membership_->failed(failure, Clock::now());
  announce_repeatedly();
}

void Link::leave() {
  const auto begin = Clock::now();
  note_end(begin);
  membership_->finished(begin);
  // The plant ends well only when all have: it waits for who is not silent for give_up_s. The
  // others wait until it knows of their end, which is not theirs any more; and for that of the
  // others: the logger, which alone knows whether the log is whole, may still fail.
  const auto over = [&] {
    if (membership_->failure()) return true;
    if (self_.who.role == Role::plant) return membership_->all_finished();
    return (membership_->end_is_known() && membership_->all_finished()) ||
           Clock::now() - begin >= longest_leaving;
  };
  while (!over()) {
    throw_if_interrupted();
    const auto now = Clock::now();
    membership_->poll(now);
    announce(now);
    handle_until(now + leaving_period, over);
  }
  announce_repeatedly();
  if (membership_->failure()) throw Failure(*membership_->failure());
}

void Link::handle_until(Clock::time_point deadline, const std::function<bool()>& over) {
  while (!over() && Clock::now() < deadline) {
    if (const auto datagram = transport_.receive(deadline)) handle(*datagram);
  }
}

void Link::tell_who_is_missing(Clock::time_point now) {
  next_notice_ = now + notice_period;
  const auto roles = membership_->missing();
  if (roles.empty()) return;
  diagnostics::log_info("waiting for {} on {}", diagnostics::joined(roles), channel_);
}

std::string Link::silent_among(std::initializer_list<Role> roles) const {
  // Several announcements missed in a row.
  constexpr auto silent_after = 10 * Membership::period;
  std::vector<std::string> silent;
  std::vector<std::string> all;
  for (const Role role : roles) {
    all.push_back(describe(role));
    const auto silence = membership_->silence(role, Clock::now());
    if (!silence || *silence >= silent_after) silent.push_back(all.back());
  }
  return silent.empty() ? diagnostics::joined(all, " or ") : diagnostics::joined(silent, " and ");
}

}  // namespace tachless::node
