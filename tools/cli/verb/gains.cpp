// The verb that changes the law's gains in a run: gains.

#include <CLI/CLI.hpp>
#include <chrono>
#include <iostream>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/logging.h"
#include "bus/authenticated.h"
#include "bus/key.h"
#include "bus/udp_transport.h"
#include "certify/prediction.h"
#include "cli/verb.h"
#include "controller/registry.h"
#include "logger/run_log.h"
#include "messages/wire.h"
#include "scenario/gains.h"
#include "session/options.h"

namespace tachless::cli {
namespace {

using namespace std::chrono_literals;
using base::Clock;
using base::ExitCode;
using base::Failure;

constexpr auto longest_wait = 5s;  // RUN_INFO comes once a second, and a machine may be busy
constexpr auto send_again = 20ms;

/// A robot's run under way, as an observer of the bus sees it. It knows what a change of gains
/// needs.
class RunningRobot {
 public:
  /// @param robot name of the robot, in any case
  RunningRobot(const std::string& robot, const bus::LcmUrl& url, const std::optional<bus::Key>& key)
      : transport_(url),
        bus_(transport_, key),
        prefix_(messages::channel_prefix(robot)),
        acks_(messages::port<messages::GainAck>(prefix_, {})) {
    if (robot.size() > 32) {
      throw base::bad_usage("{}: no robot has such a name; allowed: at most 32 characters", robot);
    }
    for (const std::string& channel : {messages::channel<messages::Participant>(prefix_),
                                       messages::channel<messages::RunInfo>(prefix_),
                                       messages::channel<messages::ReferencePoint>(prefix_),
                                       messages::channel<messages::Tick>(prefix_), acks_.channel}) {
      bus_.subscribe(channel);
    }
  }

  /// Waits until the run is known.
  /// @throw base::Failure(peer_lost) if no run is heard
  void find() {
    const auto until = Clock::now() + longest_wait;
    while (newest_ < 0 && Clock::now() < until) receive(until);
    if (newest_ >= 0) return;
    throw Failure(ExitCode::peer_lost,
                  "{}: no run of that robot is heard on this bus; type: tachless watch; with a key "
                  "each program needs --key-file",
                  prefix_);
  }

  [[nodiscard]] const scenario::Scenario& scenario() const { return run_->scenario; }
  [[nodiscard]] std::int64_t run() const { return run_->run_id; }
  [[nodiscard]] const std::string& gains() const { return gains_; }  ///< in force

  /// Sends gains until the reference acknowledges them under the key of the session. Only the
  /// acknowledgement counts, because a recording cannot contain the random number of this change.
  /// @return the first tick with the gains, after the plant has begun it
  /// @throw base::Failure(peer_lost) without an acknowledgement
  std::int64_t change(const std::string& gains) {
    messages::Codec<messages::GainChange> codec{messages::Layout{}};
    const messages::Stamp stamp{0, run(), newest_};  // of all copies: only one counts
    const messages::GainChange change{gains, gains_, scenario().digest, bus::random_number()};
    const std::string channel = messages::channel<messages::GainChange>(prefix_);
    const auto until = Clock::now() + longest_wait;
    number_ = change.number;
    while (!changed_at_ && Clock::now() < until) {
      bus_.publish(channel, codec.encode(stamp, change));
      const auto again = Clock::now() + send_again;
      while (!changed_at_ && Clock::now() < again) receive(again);
    }
    while (changed_at_ && begun_ < *changed_at_ && Clock::now() < until) receive(until);
    if (changed_at_ && begun_ >= *changed_at_) return *changed_at_;
    throw Failure(ExitCode::peer_lost,
                  "{}: the run has not acknowledged the gains within {} s; see its output", prefix_,
                  std::chrono::seconds(longest_wait).count());
  }

 private:
  /// Handles one message, if one comes before `until`.
  void receive(Clock::time_point until) {
    const auto datagram = bus_.receive(until);
    if (!datagram) return;
    messages::Stamp stamp;
    if (datagram->channel == messages::channel<messages::Participant>(prefix_)) {
      messages::Participant who;
      const auto rejection = participants_.decode(datagram->payload, stamp, who);
      if (rejection == messages::Rejection::none && who.role == messages::Role::plant &&
          who.state == messages::ParticipantState::running && !changed_at_) {
        bus_.enter(stamp.run, who.roster);
      }
    } else if (datagram->channel == messages::channel<messages::RunInfo>(prefix_)) {
      take_info(*datagram);
    } else if (datagram->channel == acks_.channel) {
      messages::GainAck ack;
      const auto rejection = acks_.codec.decode(datagram->payload, stamp, ack);
      if (rejection == messages::Rejection::none && run_ && stamp.run == run() && number_ != 0 &&
          ack.number == number_ && !changed_at_) {
        changed_at_ = stamp.tick;
        begun_ = -1;  // a tick counts only in the session that has acknowledged
      }
    } else if (run_) {
      take_tick(*datagram);
    }
  }

  void take_info(const bus::Datagram& datagram) {
    if (datagram.payload.size() < messages::stamp_end || number_ != 0 ||
        (run_ && messages::stamp_of(datagram.payload).run == run_->run_id)) {
      return;
    }
    logger::RunDescription found;
    if (!logger::read_run_info(datagram.channel, datagram.payload, "RUN_INFO", found).empty()) {
      return;
    }
    references_.emplace(found.layout);
    run_ = std::move(found);
    newest_ = begun_ = -1;
  }

  void take_tick(const bus::Datagram& datagram) {
    messages::Stamp stamp;
    messages::Tick tick;
    messages::ReferencePoint reference;
    if (datagram.channel == messages::channel<messages::Tick>(prefix_)) {
      const auto rejection = ticks_.decode(datagram.payload, stamp, tick);
      if (rejection == messages::Rejection::none && stamp.run == run()) begun_ = stamp.tick;
      return;
    }
    const auto rejection = references_->decode(datagram.payload, stamp, reference);
    if (rejection != messages::Rejection::none || stamp.run != run() || stamp.tick <= newest_)
      return;
    newest_ = stamp.tick;
    gains_ = reference.gains;
  }

  bus::UdpTransport transport_;
  bus::Authenticated bus_;
  std::string prefix_;
  messages::Codec<messages::Participant> participants_{messages::Layout{}};
  messages::Codec<messages::Tick> ticks_{messages::Layout{}};
  std::optional<messages::Codec<messages::ReferencePoint>> references_;  ///< as of `run_`
  std::optional<logger::RunDescription> run_;
  messages::Port<messages::GainAck> acks_;
  std::int64_t newest_ = -1;                ///< newest tick with a reference
  std::int64_t begun_ = -1;                 ///< newest tick that the plant has begun
  std::string gains_;                       ///< of the newest reference
  std::int64_t number_ = 0;                 ///< of the change that is sent; 0: none
  std::optional<std::int64_t> changed_at_;  ///< the first tick with the change, once acknowledged
};

struct GainsVerb {
  std::string robot;
  std::vector<std::string> changes;
  std::string lcm_url = session::default_lcm_url;
  std::string key_file;
  bool json = false;

  void declare(CLI::App& command) {
    command.add_option("ROBOT", robot, "Name of the robot in the run (robot.name)")->required();
    command
        .add_option("GAIN", changes, "GAIN=VALUE, as in controller.gains: 'kp=[400, 300]', a=200")
        ->required();
    session::add_lcm_url(command, lcm_url);
    session::add_key_file(command, key_file);
    add_json(command, json);
  }

  [[nodiscard]] ExitCode run() const {
    for (const std::string& change : changes) {
      if (change.find('=') == std::string::npos) {
        throw base::bad_usage("{}: no '='; write GAIN=VALUE, such as 'kp=[400, 300]'", change);
      }
    }
    RunningRobot running(robot, session::parse_lcm_url(lcm_url), bus::read_key_file(key_file));
    running.find();
    const scenario::Scenario changed = changed_scenario(running.scenario(), running.gains());
    const certify::Prediction loop = certify::analyse(changed, linear::Effort::quick);
    if (!loop.unknown.empty() || !loop.stable) {
      throw base::bad_usage("{}: these gains are not sent: {}", robot, certify::text(loop));
    }
    const std::string gains = scenario::gains_text(changed.controller.gains);
    const std::int64_t tick = running.change(gains);
    const double time_s = static_cast<double>(tick) * changed.loop.period_s;
    print(json,
          {{"robot", robot},
           {"run", running.run()},
           {"tick", tick},
           {"time_s", time_s},
           {"gains", gains}},
          fmt::format("{}: from tick {} ({:.4g} s) on {}\n{}\n", robot, tick, time_s, gains,
                      certify::text(loop)));
    return ExitCode::done;
  }

 private:
  /// Returns the run's scenario with the new gains.
  [[nodiscard]] scenario::Scenario changed_scenario(const scenario::Scenario& recorded,
                                                    const std::string& in_force) const try {
    if (!recorded.controller.gains_may_change) {
      throw base::bad_usage(
          "{}: its gains may not change in a run; start it with --set "
          "controller.gains_may_change=true",
          robot);
    }
    std::vector<std::string> overrides;
    for (const std::string& change : changes) overrides.push_back("controller.gains." + change);
    const scenario::Scenario given = scenario::parse_scenario(
        recorded.text, recorded.robot.urdf_text, recorded.source, overrides);
    scenario::Scenario changed = controller::with_gains(recorded, in_force);
    for (const std::string& change : changes) {
      const std::string name = change.substr(0, change.find_first_of("=[."));
      changed.controller.gains[name] = given.controller.gains.at(name);
    }
    changed.where = given.where;
    controller::scenario_law(changed);  // refuses what the law cannot work with
    controller::require_same_counts(recorded, changed, controller::law_facts(changed));
    return changed;
  } catch (const base::Failure& failure) {
    std::string_view why = failure.what();
    constexpr std::string_view not_typed = "--set controller.gains.";
    if (why.starts_with(not_typed)) why.remove_prefix(not_typed.size());
    throw base::bad_usage(why);
  }
};

}  // namespace

const Verb gains_verb = verb_of<GainsVerb>(
    "gains", "Changes the law's gains during a run, if the loop stays stable",
    "  tachless run scenarios/practical_rigid.yaml --mode realtime --duration 60 \\\n"
    "      --set controller.gains_may_change=true &\n"
    "  tachless gains arm 'kp=[300, 200]' 'kd=[60, 40]'\n"
    "Exit code 2 when the gains are refused, 3 when there is no such run.");

}  // namespace tachless::cli
