#include "node/session.h"

#include <unistd.h>

#include <array>
#include <chrono>
#include <exception>
#include <random>

#include "diagnostics/logging.h"

namespace tachless::node {
namespace {

using namespace std::chrono_literals;
using loop::Clock;
using loop::Role;

constexpr auto first_notice = 1s;
constexpr auto notice_period = 5s;
constexpr auto farewell_period = 20ms;
constexpr auto longest_farewell = 1s;
// A last word that is not waited for is said several times, some time apart: a burst is lost
// as a whole more often than not.
constexpr int last_words = 5;
// Nobody of our own kind among so many announcements for so long: the keys differ.
constexpr int least_strangers = 5;
constexpr auto strange_for = 1500ms;
constexpr auto last_words_period = 5ms;

std::int64_t random_instance() {
  std::random_device device;
  const std::uint64_t high = device();
  const std::uint64_t low = device();
  return static_cast<std::int64_t>((high << 32 | low) >> 1) | 1;
}

std::int64_t run_from_time() {
  return std::chrono::system_clock::now().time_since_epoch() / std::chrono::microseconds(1);
}

std::string host_name() {
  std::array<char, 256> name{};
  return gethostname(name.data(), name.size() - 1) == 0 ? name.data() : "";
}

}  // namespace

Session::Session(const experiment::Scenario& scenario, bus::Transport& transport,
                 const Config& config)
    : transport_(transport),
      config_(config),
      channel_(loop::channel<loop::Participant>(scenario.robot.channel_prefix)),
      codec_(loop::Layout{}) {
  self_.role = config.role;
  self_.instance = config.instance != 0 ? config.instance : random_instance();
  self_.digest = scenario.digest;
  self_.pid = static_cast<std::int32_t>(getpid());
  self_.host = host_name();
  self_.scenario = scenario.name.substr(0, loop::max_participant_text);
  if (config.role == Role::plant) self_.run = config.run_id.value_or(run_from_time());
  if (config.wait_s > 0) {
    self_.wait_limit = std::chrono::duration_cast<std::chrono::nanoseconds>(
        std::chrono::duration<double>(config.wait_s));
  }
  self_.give_up = std::chrono::duration_cast<std::chrono::nanoseconds>(
      std::chrono::duration<double>(scenario.loop.give_up_s));
  self_.takeover = scenario.loop.mode == experiment::Mode::lockstep;
  self_.resumes = config.resume;
  membership_.emplace(self_, Clock::now());
  statistics_.role = config.role;
  if (config.follow) {
    Following recording;
    recording.last_tick = scenario.loop.num_ticks - 1;
    following_ = recording;
  } else {
    transport_.subscribe(channel_);
  }
}

void Session::play(const std::function<void()>& part) {
  try {
    part();
  } catch (const diagnostics::Failure& failure) {
    announce_fault(failure);
    throw;
  } catch (const std::exception& error) {
    announce_fault(diagnostics::Failure(diagnostics::ExitCode::protocol_violated, error.what()));
    throw;
  }
}

void Session::meet(const std::string& measurement, const std::string& signals,
                   const std::function<void(const bus::Datagram&)>& other) {
  const auto now = Clock::now();
  if (following_) {
    following_->progress_at = following_->look_at = now;
    statistics_.run_id = run();
    diagnostics::log_info("following run " + std::to_string(run()) + " as it is played back");
    return;
  }
  self_.measurement = measurement;
  self_.signals = signals;
  membership_.emplace(self_, now);
  next_notice_ = now + first_notice;
  while (!membership_->joined()) {
    attend(Clock::now());
    const auto datagram = transport_.receive(next_attention());
    if (datagram && !take(*datagram) && other) other(*datagram);
    if (config_.authenticated != nullptr) {
      if (const auto stranger = config_.authenticated->take_stranger()) {
        note_stranger(stranger->kind, stranger->who, stranger->sender);
      }
    }
    refuse_strangers(Clock::now());
  }
  if (config_.resume) listen_for_predecessor();
  statistics_.run_id = run();
}

/// One that still speaks is not succeeded: the rendezvous fails when it is heard.
void Session::listen_for_predecessor() {
  const auto until = Clock::now() + protocol::Membership::takeover_after;
  for (auto now = Clock::now(); now < until; now = Clock::now()) {
    attend(now);
    if (const auto datagram = transport_.receive(std::min(until, next_attention()))) {
      take(*datagram);
    }
  }
}

void Session::stay_in_touch() {
  while (const auto datagram = transport_.receive(Clock::time_point())) take(*datagram);
  attend(Clock::now());
}

void Session::started(Clock::time_point now) {
  if (following_) {
    if (following_->tick < 0) started_at_ = now;
    return;
  }
  if (membership_->running()) return;
  membership_->started(now);
  started_at_ = now;
}

void Session::attend(Clock::time_point now) {
  if (config_.interrupted != nullptr && *config_.interrupted) {
    throw diagnostics::Failure(diagnostics::ExitCode::interrupted, "interrupted");
  }
  if (following_) return attend_recording(now);
  if (now >= next_attention()) {
    membership_->poll(now);
    if (!membership_->failure()) announce(now);
    if (!membership_->running() && now >= next_notice_) tell_who_is_missing(now);
  }
  if (membership_->failure()) throw diagnostics::Failure(*membership_->failure());
}

void Session::attend_recording(Clock::time_point now) {
  following_->look_at = now + protocol::Membership::period;
  const bool begun = following_->tick >= 0;
  const auto limit = begun ? std::optional(self_.give_up) : self_.wait_limit;
  if (!limit || now - following_->progress_at < *limit) return;
  const std::string run_name = "run " + std::to_string(run());
  if (!begun) {
    throw diagnostics::Failure(diagnostics::ExitCode::peer_lost,
                               "no measurement of " + run_name +
                                   " with its reference came; is that the run's id? "
                                   "`tachless info LOG` tells");
  }
  throw diagnostics::Failure(
      diagnostics::ExitCode::peer_lost,
      run_name + " goes silent after tick " + std::to_string(following_->tick) + " of " +
          std::to_string(following_->last_tick) +
          ": a measurement or reference is missing; `tachless info LOG` names the gaps");
}

bool Session::take(const bus::Datagram& datagram) {
  if (datagram.channel != channel_) return false;
  const bus::Rejection rejection = codec_.decode(datagram.payload, heard_stamp_, heard_);
  if (rejection == bus::Rejection::none) {
    membership_->handle(heard_stamp_, heard_, datagram.sender, Clock::now());
    anybody_ = true;
    if (!entered_ && membership_->joined()) {
      entered_ = true;
      if (config_.authenticated != nullptr) {
        config_.authenticated->enter(membership_->run(), membership_->plant_instance());
      }
    }
  } else {
    if (!entered_ && config_.authenticated == nullptr) {
      loop::Participant who;
      const auto kind = bus::foreign_participant(datagram.payload, codec_, who);
      if (kind) note_stranger(*kind, who, datagram.sender);
    }
    statistics_.rejected.add(rejection);
  }
  return true;
}

void Session::stopping(const diagnostics::Failure& failure, Clock::time_point now) {
  membership_->stopping(failure, now);
  announce(now);
}

void Session::note_stranger(bus::Foreign kind, const loop::Participant& who,
                            std::string_view sender) {
  if (strangers_heard_++ > 0) return;
  stranger_since_ = Clock::now();
  std::string has = " has no key, this ";
  if (kind == bus::Foreign::other_key) {
    has = config_.authenticated != nullptr ? " has another key than this " : " has a key, this ";
  }
  stranger_ = "the " + std::string(loop::name(who.role)) + " (process " + std::to_string(who.pid) +
              (who.host.empty() ? "" : " on " + who.host) + ", " + std::string(sender) + ")" + has +
              std::string(loop::name(config_.role)) +
              (config_.authenticated == nullptr ? " has none" : "");
}

void Session::refuse_strangers(Clock::time_point now) const {
  if (anybody_ || strangers_heard_ < least_strangers || now - stranger_since_ < strange_for) return;
  throw diagnostics::Failure(
      diagnostics::ExitCode::protocol_violated,
      stranger_ + "; give all four programs the same --key-file (or TACHLESS_KEY_FILE)");
}

void Session::announce(Clock::time_point now) {
  const auto& announcement = membership_->announce(now);
  transport_.publish(channel_, codec_.encode(announcement.stamp, announcement.participant));
}

void Session::listen_until(Clock::time_point deadline) {
  while (Clock::now() < deadline) {
    if (const auto datagram = transport_.receive(deadline)) take(*datagram);
  }
}

void Session::finish() {
  const auto begin = Clock::now();
  statistics_.wall_s = std::chrono::duration<double>(begin - started_at_).count();
  if (following_) return;
  membership_->finished(begin);
  if (config_.role == Role::plant) {
    // The others' last words may be lost: what is recorded is recorded, nobody waits for ever.
    while (Clock::now() < begin + longest_farewell) {
      announce(Clock::now());
      const auto next = Clock::now() + farewell_period;
      while (!membership_->all_finished() && Clock::now() < next) {
        if (const auto datagram = transport_.receive(next)) take(*datagram);
      }
      if (membership_->all_finished()) break;
    }
  } else {
    for (int i = 0; i < last_words; ++i) {
      announce(Clock::now());
      listen_until(Clock::now() + last_words_period);
    }
  }
}

void Session::announce_fault(const diagnostics::Failure& failure) {
  statistics_.exit_code = failure.code();
  statistics_.fault = failure.what();
  if (started_at_ != Clock::time_point()) {
    statistics_.wall_s = std::chrono::duration<double>(Clock::now() - started_at_).count();
  }
  membership_->failed(failure, Clock::now());
  for (int i = 0; i < last_words; ++i) {
    announce(Clock::now());
    listen_until(Clock::now() + last_words_period);
  }
}

void Session::tell_who_is_missing(Clock::time_point now) {
  next_notice_ = now + notice_period;
  std::string roles;
  for (const Role role : membership_->missing()) {
    roles += (roles.empty() ? "" : ", ") + std::string(loop::name(role));
  }
  if (!roles.empty()) diagnostics::log_info("waiting for " + roles + " on " + channel_);
}

std::string Session::silent_among(std::initializer_list<Role> roles) const {
  // Several heartbeats missed in a row.
  constexpr auto silent_after = 10 * protocol::Membership::period;
  std::string silent;
  std::string all;
  for (const Role role : roles) {
    const std::string who = describe(role);
    all += (all.empty() ? "" : " or ") + who;
    const auto silence = membership_->silence(role, Clock::now());
    if (!silence || *silence >= silent_after) silent += (silent.empty() ? "" : " and ") + who;
  }
  return silent.empty() ? all : silent;
}

}  // namespace tachless::node
