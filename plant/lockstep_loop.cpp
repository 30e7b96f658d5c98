#include "plant/lockstep_loop.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <stdexcept>

#include "app/version.h"
#include "plant/plant_model.h"

namespace plant {
namespace {

using bus::Clock;
using bus::lockstep::MessageRing;
using bus::lockstep::Requester;
using bus::lockstep::Verdict;

enum Kind : int { tick_kind, measurement_kind, truth_kind };

Requester::Config requester_config(const app::Scenario& scenario) {
  Requester::Config config;
  config.num_ticks = scenario.loop.num_ticks;
  config.give_up = std::chrono::duration_cast<std::chrono::nanoseconds>(
      std::chrono::duration<double>(scenario.loop.give_up_s));
  return config;
}

bus::Layout layout_of(const app::Scenario& scenario) {
  return {.num_joints = scenario.num_joints,
          .num_motors = scenario.robot.flexible ? scenario.num_joints : 0,
          .num_filters = 0};
}

}  // namespace

LockstepLoop::LockstepLoop(const app::Scenario& scenario, bus::Transport& transport,
                           app::Session& session)
    : scenario_(scenario),
      transport_(transport),
      session_(session),
      model_(plant_model(scenario)),
      arm_(make_arm(scenario, model_)),
      encoder_(scenario, model_),
      drive_(make_drive(scenario, model_)),
      layout_(layout_of(scenario)),
      tick_channel_(bus::channel<bus::Tick>(scenario.robot.channel_prefix)),
      command_channel_(bus::channel<robot::TorqueCommand>(scenario.robot.channel_prefix)),
      truth_channel_(bus::channel<bus::truth::PlantTruth>(scenario.robot.channel_prefix)),
      run_info_channel_(bus::channel<bus::RunInfo>(scenario.robot.channel_prefix)),
      ack_channel_(bus::channel<bus::LogAck>(scenario.robot.channel_prefix)),
      tick_codec_(layout_),
      command_codec_(layout_),
      truth_codec_(layout_),
      ack_codec_(layout_),
      requester_(requester_config(scenario), command_codec_.longest()) {
  transport_.subscribe(command_channel_);
  transport_.subscribe(ack_channel_);
  session_.statistics().saturated_ticks.assign(static_cast<std::size_t>(scenario.num_joints), 0);
}

bus::Stamp LockstepLoop::stamp(std::int64_t tick) const {
  const double time_s = static_cast<double>(tick) * scenario_.loop.period_s;
  return {std::llround(time_s * 1e6), session_.run(), tick};
}

void LockstepLoop::run() {
  session_.meet();
  measurement_ = make_measurement_source(session_.measurement(), scenario_, encoder_, layout_);
  measurement_channel_ = measurement_->channel();
  sent_.emplace(std::array{tick_codec_.longest(), measurement_->longest(), truth_codec_.longest()});
  introduce();
  while (!requester_.finished()) {
    const auto now = Clock::now();
    session_.attend(now);
    repeat(now);
    if (requester_.may_begin()) begin_tick();
    give_up_if_lost(now);
    receive(std::min(requester_.deadline(), session_.next_attention()));
  }
  session_.finish();
}

void LockstepLoop::introduce() {
  bus::RunInfo info;
  info.num_ticks = scenario_.loop.num_ticks;
  info.period_s = scenario_.loop.period_s;
  info.version = app::version;
  info.robot = scenario_.robot.channel_prefix;
  info.measurement = session_.measurement();
  info.scenario = scenario_.text;
  info.robot_description = scenario_.robot.urdf_text;
  try {
    bus::Codec<bus::RunInfo> codec(layout_);
    const auto bytes = codec.encode({0, session_.run(), -1}, info);
    run_info_.assign(bytes.begin(), bytes.end());
  } catch (const std::length_error&) {
    throw app::Failure(app::ExitCode::bad_usage,
                       scenario_.source + ": scenario and URDF have " +
                           std::to_string(info.scenario.size() + info.robot_description.size()) +
                           " characters together; allowed: about " +
                           std::to_string(bus::max_run_info_size - 200) +
                           ", for a log holds them in one message");
  }
  const auto now = Clock::now();
  session_.started(now);
  session_.attend(now);
  transport_.publish(run_info_channel_, run_info_);
  requester_.introduced(now);
}

void LockstepLoop::begin_tick() {
  const std::int64_t k = requester_.next_tick();
  const auto measurement = measurement_->measure(arm_.state(), stamp(k));
  requester_.asked(Clock::now());
  transport_.publish(measurement_channel_, measurement);  // first: the command waits for it
  sent_->put(k, measurement_kind, measurement);
  const auto tick = tick_codec_.encode(stamp(k), {.last = k + 1 == scenario_.loop.num_ticks});
  transport_.publish(tick_channel_, tick);
  sent_->put(k, tick_kind, tick);
}

void LockstepLoop::receive(Clock::time_point deadline) {
  const auto datagram = transport_.receive(deadline);
  if (!datagram || session_.take(*datagram)) return;
  if (datagram->channel == command_channel_) {
    on_command(*datagram);
  } else if (datagram->channel == ack_channel_) {
    on_ack(*datagram);
  }
}

template <class Value>
bool LockstepLoop::accept(const bus::Codec<Value>& codec, const bus::Datagram& datagram,
                          bus::Stamp& stamp, Value& value) {
  const bus::Rejection rejection = codec.decode(datagram.payload, stamp, value);
  if (rejection != bus::Rejection::none) {
    session_.statistics().rejected.add(rejection);
  } else if (stamp.run != session_.run()) {
    session_.statistics().rejected.add(app::Unusable::other_run);
  } else {
    return true;
  }
  return false;
}

void LockstepLoop::on_command(const bus::Datagram& datagram) {
  bus::Stamp stamp;
  if (!accept(command_codec_, datagram, stamp, command_)) return;
  app::Statistics& statistics = session_.statistics();
  switch (requester_.on_command(stamp.tick, datagram.payload, datagram.sender, Clock::now())) {
    case Verdict::fresh:
      statistics.round_trip.add(requester_.round_trip());
      return end_tick();
    case Verdict::repeated:
      ++statistics.duplicates;
      return;
    case Verdict::not_asked:
      return statistics.rejected.add(app::Unusable::not_asked);
    case Verdict::too_old:
      return statistics.rejected.add(app::Unusable::too_old);
    case Verdict::conflicting:
      throw app::Failure(app::ExitCode::protocol_violated,
                         "two processes command run " + std::to_string(stamp.run) + ": " +
                             std::string(requester_.commander(stamp.tick)) + " and " +
                             std::string(datagram.sender) + " sent different commands for tick " +
                             std::to_string(stamp.tick) + "; this run's controller is " +
                             session_.describe(bus::Role::controller) + ", end the other");
  }
}

void LockstepLoop::on_ack(const bus::Datagram& datagram) {
  bus::Stamp stamp;
  bus::LogAck ack;
  if (!accept(ack_codec_, datagram, stamp, ack)) return;
  app::Statistics& statistics = session_.statistics();
  const Verdict verdict = requester_.on_ack(stamp.tick, ack.missing, Clock::now());
  if (verdict == Verdict::not_asked) statistics.rejected.add(app::Unusable::not_asked);
  if (verdict == Verdict::too_old) statistics.rejected.add(app::Unusable::too_old);
}

void LockstepLoop::end_tick() {
  const std::int64_t k = requester_.next_tick();
  if (!drive_.accept(command_)) {
    throw std::logic_error("a command that is not finite got past the checks");
  }
  const AppliedTorque& applied = drive_.applied();
  const ArmState& state = arm_.state();
  truth_.q = state.q;
  truth_.v = state.v;
  truth_.theta = state.theta;
  truth_.thetadot = state.thetadot;
  truth_.tau = applied.tau;
  truth_.saturated = applied.saturated;
  if (!bus::truth::all_finite(truth_)) {
    throw app::Failure(app::ExitCode::protective_stop,
                       "the plant's state at tick " + std::to_string(k) +
                           " is not finite: the loop is unstable; compare its period with the "
                           "limit that `tachless certify` gives for these gains");
  }
  const auto truth = truth_codec_.encode(stamp(k), truth_);
  transport_.publish(truth_channel_, truth);
  sent_->put(k, truth_kind, truth);

  app::Statistics& statistics = session_.statistics();
  for (int i = 0; i < scenario_.num_joints; ++i) {
    const auto joint = static_cast<std::size_t>(i);
    statistics.saturated_ticks[joint] += applied.saturated[joint] ? 1 : 0;
  }
  advance(k);
  drive_.end_tick();
  requester_.completed(Clock::now());
  session_.progressed(k);
  statistics.ticks = k + 1;
}

void LockstepLoop::advance(std::int64_t tick) {
  const auto begin = Clock::now();
  try {
    arm_.advance(drive_.applied().tau, static_cast<double>(tick + 1) * scenario_.loop.period_s);
  } catch (const std::runtime_error& problem) {
    throw app::Failure(app::ExitCode::protective_stop,
                       "the simulation failed at tick " + std::to_string(tick) + ": " +
                           problem.what() +
                           "; a loop that is unstable at this period ends like this, see "
                           "`tachless certify`");
  }
  session_.statistics().work.add(Clock::now() - begin);
}

void LockstepLoop::repeat(Clock::time_point now) {
  app::Statistics& statistics = session_.statistics();
  while (const auto repeat = requester_.next_repeat(now)) {
    if (repeat->what == Requester::Repeat::What::run_info) {
      transport_.publish(run_info_channel_, run_info_);
      ++statistics.resends;
      continue;
    }
    const std::int64_t k = repeat->tick;
    transport_.publish(tick_channel_, sent_->bytes(k, tick_kind));
    transport_.publish(measurement_channel_, sent_->bytes(k, measurement_kind));
    statistics.resends += 2;
    if (repeat->what == Requester::Repeat::What::all) {
      transport_.publish(truth_channel_, sent_->bytes(k, truth_kind));
      ++statistics.resends;
    }
  }
}

void LockstepLoop::give_up_if_lost(Clock::time_point now) const {
  using bus::Role;
  if (!requester_.given_up(now)) return;
  std::string who;
  std::string what;
  switch (requester_.waiting()) {
    case Requester::Waiting::nobody:
      return;
    case Requester::Waiting::command:
      who = session_.silent_among({Role::controller, Role::reference});
      what = "no command for tick " + std::to_string(requester_.next_tick());
      break;
    case Requester::Waiting::logger_for_run_info:
      who = session_.describe(Role::logger);
      what = "RUN_INFO is not acknowledged";
      break;
    case Requester::Waiting::logger_for_window:
    case Requester::Waiting::logger_for_end:
      who = requester_.logger_heard()
                ? session_.silent_among({Role::controller, Role::reference, Role::logger})
                : session_.describe(Role::logger);
      what = "tick " + std::to_string(requester_.acknowledged() + 1) + " is not recorded";
      break;
  }
  std::array<char, 32> duration{};
  std::snprintf(duration.data(), duration.size(), "%.3g s", scenario_.loop.give_up_s);
  throw app::Failure(app::ExitCode::peer_lost, what + " for " + duration.data() + ": lost is " +
                                                   who + "; see its output (loop.give_up_s)");
}

}  // namespace plant
