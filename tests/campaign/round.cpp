#include "tests/campaign/round.h"

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdlib>
#include <future>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <system_error>

#include "logger/log_file.h"
#include "messages/wire.h"
#include "tests/campaign/attacker.h"

namespace tachless::campaign {
namespace {

using namespace std::chrono_literals;
using base::Clock;
using messages::Role;
using system_test::FourThreads;

// No round needs longer to wait for members and then to notice a lost one.
constexpr auto hung_after = 30s;

/// The undisturbed run of this experiment, with all its messages.
struct Clean {
  scenario::Scenario scenario;
  std::vector<Event> log;
  std::uintmax_t log_bytes = 0;
  std::vector<Sent> recording;
};

/// Starts the processes and waits for them. It interrupts a run that does not end, and aborts if
/// the run still does not end.
void finish(FourThreads& threads, Evidence& into) {
  auto result = std::async(std::launch::async, [&] { return threads.finish(); });
  if (result.wait_for(hung_after) != std::future_status::ready) {
    into.hung = true;
    for (const Role role : system_test::all_roles) threads.interrupt(role);
    if (result.wait_for(hung_after) != std::future_status::ready) {
      fmt::print(stderr, "seed {} hangs for ever: {}\n", into.plan.seed, describe(into.plan));
      std::abort();
    }
  }
  into.result = result.get();
}

scenario::Scenario scenario_of(Pace pace) {
  const Experiment what = experiment_of(pace);
  return system_test::scenario(what.name, what.overrides);
}

const Clean& clean(Pace pace, bool keyed) {
  static std::array<std::once_flag, 6> once;
  static std::array<std::unique_ptr<Clean>, 6> runs;
  const std::size_t index = 2 * static_cast<std::size_t>(pace) + (keyed ? 1 : 0);
  std::call_once(once.at(index), [&] {
    auto run = std::make_unique<Clean>(Clean{scenario_of(pace), {}, 0, {}});
    FourThreads threads(run->scenario);
    if (keyed) threads.give_key(key());
    Evidence evidence;
    Lies none;
    Attacker listener(threads.network().connect("a listener"), {}, 0, {}, none);
    finish(threads, evidence);
    listener.stop();
    if (!evidence.all_done()) throw std::runtime_error(evidence.result.complaints());
    read_log(threads.log_path(), evidence);
    run->log = std::move(evidence.log);
    run->log_bytes = evidence.log_bytes;
    run->recording = listener.received();
    runs.at(index) = std::move(run);
  });
  return *runs.at(index);
}

}  // namespace

Experiment experiment_of(Pace pace) {
  if (pace == Pace::lockstep) {
    return {"paper_rigid", {"loop.duration_s=0.01", "loop.give_up_s=3", "plant.mechanics=native"}};
  }
  std::vector<std::string> at_rest = {"loop.mode=realtime",
                                      "loop.max_missed=1000000",
                                      "loop.max_missed_share=1",
                                      "robot.gravity_m_per_s2=0",
                                      "plant.mechanics=native",
                                      "plant.encoder.resolution_bits=null",
                                      "reference={hold: {position_rad: [0, 0]}}"};
  at_rest.emplace_back(pace == Pace::realtime ? "loop.duration_s=0.3" : "loop.duration_s=3");
  at_rest.emplace_back(pace == Pace::realtime ? "loop.give_up_s=3" : "loop.give_up_s=1");
  return {"practical_rigid", at_rest};
}

bus::Key key() {
  bus::Key key;
  std::ranges::fill(key.bytes(), static_cast<unsigned char>(0x35));
  return key;
}

void read_log(const std::filesystem::path& path, Evidence& into) {
  std::error_code absent;
  const auto size = std::filesystem::file_size(path, absent);
  if (absent || size == 0) return;
  into.log_bytes = size;
  logger::LogReader log(path);
  while (const auto event = log.next()) {
    const bool stamped = event->data.size() >= messages::stamp_end;
    into.log.push_back({std::string(event->channel),
                        stamped ? messages::stamp_of(event->data).tick : -2,
                        {reinterpret_cast<const char*>(event->data.data()), event->data.size()}});
  }
  into.log_damaged = log.damage().any();
}

bool Event::is_fault() const {
  static const std::string participants = messages::channel<messages::Participant>("ARM");
  if (channel != participants) return false;
  const messages::Codec<messages::Participant> codec(messages::Layout{});
  messages::Stamp stamp;
  messages::Participant who;
  const auto bytes = std::as_bytes(std::span(data));
  return codec.decode(bytes, stamp, who) == messages::Rejection::none &&
         who.state == messages::ParticipantState::fault;
}

bool Evidence::lives(Role role) const {
  if (!mishap_happened || plan.mishap->role != role) return true;
  return plan.mishap->kind != Mishap::Kind::kill && plan.mishap->kind != Mishap::Kind::fail;
}

Evidence expected(const Plan& plan) {
  // The clean run has no key, so logs with a key are compared with logs without one.
  const Clean& plain = clean(plan.pace, false);
  Evidence evidence;
  evidence.plan = plan;
  evidence.num_ticks = plain.scenario.loop.num_ticks;
  evidence.period_s = plain.scenario.loop.period_s;
  evidence.give_up_s = plain.scenario.loop.give_up_s;
  evidence.clean_log = plain.log;
  evidence.clean_log_bytes = plain.log_bytes;
  return evidence;
}

const std::vector<Sent>& recording_for(const Plan& plan) {
  return clean(plan.pace, plan.keyed).recording;
}

Evidence play(const Plan& plan) {
  Evidence evidence = expected(plan);
  const auto& recording = recording_for(plan);
  Lies lies;
  std::atomic<bool> happened = false;
  FourThreads threads(clean(plan.pace, false).scenario, plan.network);
  threads.wait_for_others(wait_s);
  if (plan.keyed) threads.give_key(key());
  threads.wrap([&](Role role, std::unique_ptr<bus::Transport> inner) {
    if (plan.hostility && plan.hostility->races > 0) {
      inner = std::make_unique<Raced>(
          std::move(inner), threads.network().connect(plan.hostility->sender), *plan.hostility,
          plan.seed + static_cast<std::uint64_t>(role), lies);
    }
    if (plan.mishap && plan.mishap->role == role) {
      inner = std::make_unique<Afflicted>(std::move(inner), *plan.mishap, happened,
                                          [&threads, role] { threads.interrupt(role); });
    }
    return inner;
  });
  Attacker attacker(
      threads.network().connect(plan.hostility ? plan.hostility->sender : "a listener"),
      plan.hostility, plan.seed, recording, lies);
  const auto start = Clock::now();
  finish(threads, evidence);
  evidence.wall_s = std::chrono::duration<double>(Clock::now() - start).count();
  attacker.stop();
  evidence.num_hostile = plan.hostility ? attacker.num_sent() : 0;
  evidence.num_overflowed = threads.network().num_overflowed("logger's endpoint");
  evidence.lies = lies.ticks();
  evidence.mishap_happened = happened;
  read_log(threads.log_path(), evidence);
  return evidence;
}

}  // namespace tachless::campaign
