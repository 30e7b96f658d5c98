#include "session/session.h"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <exception>
#include <vector>

#include "base/clock.h"
#include "base/logging.h"
#include "base/text.h"
#include "session/options.h"

namespace tachless::session {
namespace {

using namespace std::chrono_literals;
using base::Clock;
using base::ExitCode;
using base::Failure;
using messages::Role;
using session::Membership;
using session::Receipt;

constexpr auto first_notice = 1s;
constexpr auto notice_period = 5s;
constexpr auto leaving_period = 20ms;
constexpr auto longest_leaving = 1s;
constexpr auto attending_period = 1ms;  // longest delay until the end of the wait is noticed
// Most time that the logger may take at the end beyond the time to give up, to record messages that
// are in transit.
constexpr auto longest_conclusion = 2s;
// Most time that a busy disk may take to store the log.
constexpr auto longest_sync = 60s;
// Final announcements are not acknowledged. Several are sent at intervals, because losses come in
// bursts.
constexpr int last_announcements = 5;
constexpr auto last_announcements_period = 5ms;

std::string host_name() {
  std::array<char, 256> name{};
  return gethostname(name.data(), name.size() - 1) == 0 ? name.data() : "";
}

Membership::Self self_of(const scenario::Scenario& scenario, const Session::Config& config) {
  Membership::Self self;
  self.who.role = config.role;
  self.who.instance = config.instance != 0 ? config.instance : bus::random_number();
  self.who.scenario_digest = scenario.digest;
  self.who.pid = static_cast<std::int32_t>(getpid());
  // A name may contain characters that are not allowed in a message.
  const auto text = [](const std::string& name) {
    return base::printable(name).substr(0, messages::max_participant_text);
  };
  self.who.host = text(host_name());
  self.who.scenario = text(scenario.name);
  if (config.role == Role::plant)
    self.run = config.run_id.value_or(run_id_at(std::chrono::system_clock::now()));
  if (config.wait_s > 0) self.wait_limit = base::nanoseconds_of(config.wait_s);
  self.give_up = base::nanoseconds_of(scenario.loop.give_up_s);
  self.counters_required = config.key.has_value();
  return self;
}

}  // namespace

Session::Session(const scenario::Scenario& scenario, bus::Transport& transport,
                 const Config& config)
    : transport_(transport, config.key),
      statistics_(config.role),
      interrupted_(config.interrupted),
      channel_(messages::channel<messages::Participant>(scenario.robot.channel_prefix)),
      channel_number_(transport_.subscribe(channel_)),
      self_(self_of(scenario, config)),
      codec_(messages::Layout{}),
      key_check_(config.role, config.key.has_value()) {
  membership_.emplace(self_, Clock::now());
}

void Session::guard(const std::function<void()>& main) {
  try {
    main();
  } catch (const std::exception&) {
    fail(base::current_failure());
    throw;
  } catch (...) {  // a main catches std::exception only
    const Failure failure = base::current_failure();
    fail(failure);
    throw Failure(failure);
  }
}

void Session::fail(const Failure& failure) {
  const auto now = Clock::now();
  statistics_.exit_code = failure.code();
  statistics_.fault = failure.what();
  note_end(now);
  try {
    membership_->on_failed(failure, now);
    announce_repeatedly();
  } catch (const std::exception& problem) {
    // `failure` came first and is the one that is reported.
    base::log_warning("the others cannot be informed of it: {}", problem.what());
  }
}

void Session::note_end(Time now) {
  if (started_at_ != Time()) statistics_.wall_s = base::seconds_of(now - started_at_);
}

void Session::throw_if_interrupted() const {
  if (interrupted_ != nullptr && *interrupted_) throw Failure(ExitCode::interrupted, "interrupted");
}

void Session::on(const std::string& channel, Handler handler) {
  const auto number = static_cast<std::size_t>(transport_.subscribe(channel));
  base::log_detail("receives {}", channel);
  if (handlers_.size() <= number) handlers_.resize(number + 1);
  handlers_[number] = std::move(handler);
}

void Session::join(const messages::LawInfo& law, const Handler& other) {
  const auto begin = Clock::now();
  static_cast<messages::LawInfo&>(self_.who) = law;
  membership_.emplace(self_, begin);
  next_notice_ = begin + first_notice;
  while (!membership_->has_joined()) {
    poll(Clock::now());
    const auto datagram = transport_.receive(next_poll());
    if (datagram && handle(*datagram) == Handled::no && other) other(*datagram);
    const auto now = Clock::now();
    if (const auto stranger = transport_.take_stranger()) key_check_.on_foreign(*stranger, now);
    key_check_.poll(now);
  }
  statistics_.run_id = run();
  std::vector<std::string> others;
  for (const Role role : {Role::plant, Role::reference, Role::controller, Role::logger}) {
    if (role != self_.who.role) others.push_back(describe(role));
  }
  base::log_detail("run {} on {}, with {}", run(), channel_, base::joined(others));
}

void Session::note_started(Time now) {
  if (membership_->is_running()) return;
  membership_->on_started(now);
  started_at_ = now;
}

void Session::poll(Time now) {
  throw_if_interrupted();
  if (now >= next_poll()) {
    membership_->poll(now);
    if (!membership_->failure()) announce(now);
    if (!membership_->is_running() && now >= next_notice_) name_missing(now);
  }
  const auto& failure = membership_->failure();
  if (!failure) return;
  throw Failure(failure->code(),
                failure->what() + (membership_->has_joined() ? "" : key_check_.hint()));
}

void Session::run_until(const std::function<bool()>& done, const Turn& turn) {
  while (!done()) {
    const Time now = Clock::now();
    poll(now);
    const Time due = turn ? turn(now) : Time::max();
    receive(std::min(due, next_poll()));
  }
}

void Session::attend_until(const std::function<bool()>& done) {
  while (!done()) {
    const Time now = Clock::now();
    poll(now);
    attend(now + attending_period, done);
  }
}

void Session::run_until_finished(const std::function<bool(Time)>& all_there, const Turn& turn) {
  run_until([this] { return membership_->has_plant_finished(); },
            [&](Time now) {
              if (all_there(now)) membership_->on_all_ticks_done();
              return turn ? turn(now) : Time::max();
            });
}

bool Session::receive(Time deadline) {
  const auto datagram = transport_.receive(deadline);
  if (!datagram) return false;
  const Handled handled = handle(*datagram);
  if (handled == Handled::believed && announcement_handler_) announcement_handler_(*datagram);
  if (handled != Handled::no) return true;
  const auto number = static_cast<std::size_t>(datagram->channel_number);
  if (number < handlers_.size() && handlers_[number]) handlers_[number](*datagram);
  return true;
}

bool Session::accept(messages::Rejection rejection, const messages::Stamp& stamp) {
  if (rejection != messages::Rejection::none) {
    statistics_.rejected.add(rejection);
  } else if (stamp.run != run()) {
    statistics_.rejected.add(Discard::other_run);
  } else {
    return true;
  }
  return false;
}

void Session::count(Receipt receipt) {
  if (receipt == Receipt::repeated) ++statistics_.duplicates;
  if (receipt == Receipt::not_asked) statistics_.rejected.add(Discard::not_asked);
  if (receipt == Receipt::too_old) statistics_.rejected.add(Discard::too_old);
}

void Session::count(Receipt receipt, Role from, const bus::Datagram& datagram, std::int64_t tick) {
  std::string& other = other_senders_[index(from)];
  if (!membership_->is_from(from, datagram.sender)) other = datagram.sender;
  if (receipt != Receipt::conflicting) return count(receipt);
  throw Failure(
      ExitCode::protocol_violated,
      "two processes are the {} of run {}: two different messages for tick {} came on {}, "
      "one of them from {}; the run's own is {}, end the other",
      messages::name(from), run(), tick, datagram.channel, other.empty() ? datagram.sender : other,
      describe(from));
}

Session::Handled Session::handle(const bus::Datagram& datagram) {
  if (datagram.channel_number != channel_number_) return Handled::no;
  const messages::Rejection rejection = codec_.decode(datagram.payload, stamp_, peer_);
  if (rejection != messages::Rejection::none) {
    statistics_.rejected.add(rejection);
    return Handled::dropped;
  }
  const bool believed = membership_->handle(stamp_, peer_, datagram.sender, Clock::now());
  key_check_.on_verified();
  if (membership_->has_joined() && membership_->roster() != entered_) {
    entered_ = membership_->roster();
    transport_.enter(run(), entered_);
  }
  return believed ? Handled::believed : Handled::dropped;
}

std::span<const std::byte> Session::announce(Time now) {
  const auto& announcement = membership_->announce(now);
  const auto bytes = codec_.encode(announcement.stamp, announcement.participant);
  transport_.publish(channel_, bytes);
  return bytes;
}

std::span<const std::byte> Session::announce_end(const Failure& failure) {
  const auto now = Clock::now();
  membership_->on_failed(failure, now);
  return announce(now);
}

void Session::announce_stop(const Failure& failure, Time now) {
  membership_->on_stopping(failure, now);
  announce(now);
}

void Session::announce_repeatedly() {
  // The queue is emptied first. After a long computation it holds acknowledgements that are too old
  // to count.
  announce(Clock::now());
  const auto until_empty = Clock::now() + longest_leaving;
  while (Clock::now() < until_empty) {
    const auto datagram = transport_.receive(Clock::time_point());
    if (!datagram) break;
    handle(*datagram);
  }
  // Before a run, this lasts long enough for a process started at the same time to receive the
  // reason.
  const auto until = Clock::now() + (membership_->has_joined() ? 0ms : Membership::simultaneous);
  for (int i = 0; i < last_announcements || Clock::now() < until; ++i) {
    announce(Clock::now());
    attend(Clock::now() + last_announcements_period);
  }
}

void Session::leave() {
  const auto begin = Clock::now();
  note_end(begin);
  membership_->on_finished(begin);
  // The plant finishes successfully only after the others. The others wait until the plant has
  // acknowledged their end and all have ended. The reason is that the logger may still fail: it
  // alone knows whether the log is complete.
  const auto over = [&] {
    if (membership_->failure()) return true;
    if (self_.who.role == Role::plant) return membership_->have_all_finished();
    return (membership_->is_finish_acknowledged() && membership_->have_all_finished()) ||
           Clock::now() - begin >= longest_leaving;
  };
  while (!over()) {
    throw_if_interrupted();
    const auto now = Clock::now();
    const bool lacking = membership_->others_lack_ticks();
    if (now - begin >= self_.give_up + (lacking ? longest_conclusion : longest_sync)) {
      throw Failure(ExitCode::protocol_violated, "the run is over, but {} has not finished: {}",
                    membership_->unfinished(),
                    lacking ? "ticks are missing there. If another process has acknowledged them, "
                              "find it with tachless watch, or use a key (--key-file)"
                            : "it has all ticks, but its disk may be too slow");
    }
    membership_->poll(now);
    announce(now);
    attend(now + leaving_period, over);
  }
  announce_repeatedly();
  if (membership_->failure()) throw Failure(*membership_->failure());
}

void Session::attend(Time deadline, const std::function<bool()>& over) {
  while (!over() && Clock::now() < deadline) {
    if (each_ && Clock::now() >= next_each_) {
      next_each_ = Clock::now() + each_period_;
      each_();
    }
    const auto datagram = transport_.receive(each_ ? std::min(deadline, next_each_) : deadline);
    if (datagram) handle(*datagram);
  }
}

void Session::while_attending(std::chrono::nanoseconds period, std::function<void()> each) {
  each_ = std::move(each);
  each_period_ = period;
  next_each_ = Clock::now();
}

void Session::name_missing(Time now) {
  next_notice_ = now + notice_period;
  const auto roles = membership_->missing();
  if (roles.empty()) return;
  base::log_info("waiting for {} on {}{}", base::joined(roles), channel_, key_check_.hint());
}

std::string Session::silent_among(std::initializer_list<Role> roles) const {
  // This equals several consecutive missed announcements.
  constexpr auto silent_after = 10 * Membership::period;
  std::vector<std::string> silent;
  std::vector<std::string> all;
  for (const Role role : roles) {
    all.push_back(describe(role));
    const auto silence = membership_->silence(role, Clock::now());
    if (!silence || *silence >= silent_after) silent.push_back(all.back());
  }
  return silent.empty() ? base::joined(all, " or ") : base::joined(silent, " and ");
}

}  // namespace tachless::session
