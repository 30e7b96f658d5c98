#include "tests/campaign/invariants.h"

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <set>
#include <string_view>
#include <utility>

namespace tachless::campaign {
namespace {

using base::ExitCode;
using messages::Role;
using system_test::all_roles;

constexpr std::size_t per_tick = 6;
// Longest normal round: 10 s of waiting, 3 s to notice a lost peer, 1 s to leave; the rest is for a
// busy machine.
constexpr double longest_round_s = 25;
constexpr double braking_s = 0.5;

/// Returns the log without the fault at its end.
std::span<const Event> run_of(const Evidence& evidence) {
  std::span<const Event> log = evidence.log;
  if (!log.empty() && log.back().is_fault()) log = log.first(log.size() - 1);
  return log;
}

bool lied_about(const Evidence& evidence, std::int64_t tick) {
  // A tick's command affects the messages of the next tick.
  return !evidence.plan.keyed && (evidence.lies.contains(tick) || evidence.lies.contains(tick - 1));
}

/// Returns the first place at which the log differs from the clean one without a lie as reason; ""
/// if there is none.
std::string deviation(const Evidence& evidence) {
  const auto log = run_of(evidence);
  bool deceived = false;
  for (std::size_t i = 0; i < log.size(); ++i) {
    if (i >= evidence.clean_log.size()) return fmt::format("the log has {} events", log.size());
    const Event& clean = evidence.clean_log[i];
    if (log[i].channel != clean.channel || log[i].tick != clean.tick) {
      return fmt::format("event {} is {} of tick {}, not {} of tick {}", i, log[i].channel,
                         log[i].tick, clean.channel, clean.tick);
    }
    deceived = deceived || lied_about(evidence, clean.tick);
    if (!deceived && log[i] != clean) {
      return fmt::format("{} of tick {} is not the clean run's", clean.channel, clean.tick);
    }
  }
  return "";
}

std::string missing_in_lockstep(const Evidence& evidence) {
  const std::size_t size = run_of(evidence).size();
  if (size == evidence.clean_log.size()) return deviation(evidence);
  return fmt::format("the log has {} of {} events", size, evidence.clean_log.size());
}

/// Returns the first missing message of a realtime run. Realtime repeats nothing, so a paused
/// logger may miss messages.
std::string missing_in_realtime(const Evidence& evidence) {
  if (evidence.num_overflowed > 0) return "";
  std::set<std::pair<std::string_view, std::int64_t>> there;
  for (const Event& event : evidence.log) there.insert({event.channel, event.tick});
  for (std::int64_t k = 0; k < evidence.num_ticks; ++k) {
    for (const auto* channel : {"ARM_TICK", "ARM_POSITION", "ARM_TRUTH"}) {
      if (!there.contains({channel, k})) return fmt::format("the log lacks {} of {}", channel, k);
    }
  }
  return "";
}

/// Returns whether an outsider has replaced the logger. In a run without a key the plant takes a
/// process for the logger if it acknowledges from the logger's address and announces its end. The
/// real logger then does not end with 0.
bool logger_is_impersonated(const Evidence& evidence) {
  const auto& hostility = evidence.plan.hostility;
  return !evidence.plan.keyed && hostility && hostility->acknowledges &&
         (hostility->forges || hostility->contradicts || hostility->announces) &&
         evidence.of(Role::logger).code != ExitCode::done;
}

}  // namespace

std::string a_good_end_has_a_whole_log(const Evidence& evidence) {
  for (const Role role : {Role::plant, Role::logger}) {
    if (evidence.of(role).code != ExitCode::done) continue;
    if (role == Role::plant && logger_is_impersonated(evidence)) continue;
    const auto missing =
        evidence.plan.lockstep() ? missing_in_lockstep(evidence) : missing_in_realtime(evidence);
    if (!missing.empty())
      return fmt::format("the {} ends with 0: {}", messages::name(role), missing);
  }
  return "";
}

std::string the_log_is_a_beginning_of_the_clean_one(const Evidence& evidence) {
  if (evidence.log_damaged) return "the log is damaged";
  if (!evidence.plan.lockstep()) return "";
  const std::size_t events = run_of(evidence).size();
  if (evidence.lives(Role::logger) && events > 0 && (events - 1) % per_tick != 0) {
    return fmt::format("the log's {} events are not whole ticks", events);
  }
  return deviation(evidence);
}

std::string what_cannot_end_a_run_does_not(const Evidence& evidence) {
  const bool mishap = evidence.mishap_happened && evidence.plan.mishap->kind != Mishap::Kind::stop;
  Plan plan = evidence.plan;
  if (!mishap) plan.mishap.reset();
  if (!plan.must_end_well() || evidence.all_done()) return "";
  return "nothing could end this run, and it has not ended well";
}

std::string every_fault_has_a_code_and_one_cause(const Evidence& evidence) {
  constexpr std::array documented = {ExitCode::check_said_no,   ExitCode::bad_usage,
                                     ExitCode::peer_lost,       ExitCode::protocol_violated,
                                     ExitCode::protective_stop, ExitCode::interrupted};
  // This is longer than the description of a process with its host and address, which may occur
  // twice.
  constexpr std::size_t a_sentence = 100;
  for (const Role role : all_roles) {
    const auto& [code, fault, statistics] = evidence.of(role);
    if (code == ExitCode::done || !evidence.lives(role)) continue;
    if (std::ranges::find(documented, code) == documented.end()) {
      return fmt::format("the {} ends with {}", messages::name(role), static_cast<int>(code));
    }
    if (fault.empty() || fault.ends_with(": ") ||
        fault.find("internal error") != std::string::npos) {
      return fmt::format("the {} does not say why it ends", messages::name(role));
    }
    if (fault.find('\n') != std::string::npos) {
      return fmt::format("the {} tells more than one cause: {}", messages::name(role), fault);
    }
    for (std::size_t i = 0; i + a_sentence <= fault.size(); ++i) {
      if (fault.find(fault.substr(i, a_sentence), i + 1) != std::string::npos) {
        return fmt::format("the {} says twice '{}'", messages::name(role),
                           fault.substr(i, a_sentence));
      }
    }
  }
  return "";
}

std::string the_log_ends_with_the_fault(const Evidence& evidence) {
  if (evidence.of(Role::logger).code == ExitCode::done || !evidence.lives(Role::logger)) return "";
  // A run that has not begun has no log.
  if (evidence.log.empty() || evidence.log.back().is_fault()) return "";
  return fmt::format("the log of a run that failed ends with {}", evidence.log.back().channel);
}

std::string nothing_moves_unrecorded(const Evidence& evidence) {
  if (evidence.plan.lockstep()) return "";
  std::int64_t recorded = -1;
  for (const Event& event : evidence.log) {
    if (event.channel == "ARM_TRUTH") recorded = std::max(recorded, event.tick);
  }
  const std::int64_t ticks = evidence.of(Role::plant).statistics.ticks - 1 - recorded;
  const double unrecorded_s = static_cast<double>(ticks) * evidence.period_s;
  if (unrecorded_s <= evidence.give_up_s + braking_s) return "";
  return fmt::format("the robot moves for {} s after the log's end", unrecorded_s);
}

std::string the_log_is_bounded(const Evidence& evidence) {
  if (evidence.log_bytes <= evidence.clean_log_bytes + most_foreign_log_bytes) return "";
  return fmt::format("the log has {} bytes, the clean one {}", evidence.log_bytes,
                     evidence.clean_log_bytes);
}

std::string the_log_has_sound_names(const Evidence& evidence) {
  // The check reads the bytes without the codec, because the codec itself may be wrong.
  for (const Event& event : evidence.log) {
    if (event.channel != "ARM_RUN_INFO" && event.channel != "ARM_PARTICIPANT") continue;
    for (const FieldAt& field : fields_of(event.channel, std::as_bytes(std::span(event.data)))) {
      if (field.name != "law" && field.name != "signals") continue;
      const auto text = std::string_view(event.data).substr(field.offset, field.size);
      if (field.kind == messages::Kind::text &&
          std::ranges::any_of(text, [](unsigned char c) { return c < ' ' || c == 0x7f; })) {
        return fmt::format("the log has {} with control characters in a name", event.channel);
      }
    }
  }
  return "";
}

std::string the_round_is_bounded(const Evidence& evidence) {
  if (!evidence.hung && evidence.wall_s < longest_round_s) return "";
  return fmt::format("it takes {} s{}", evidence.wall_s, evidence.hung ? ", interrupted" : "");
}

std::vector<std::string> violations(const Evidence& evidence) {
  std::vector<std::string> result;
  for (const auto& invariant :
       {a_good_end_has_a_whole_log, the_log_is_a_beginning_of_the_clean_one,
        what_cannot_end_a_run_does_not, every_fault_has_a_code_and_one_cause,
        the_log_ends_with_the_fault, nothing_moves_unrecorded, the_log_is_bounded,
        the_log_has_sound_names, the_round_is_bounded}) {
    if (auto complaint = invariant(evidence); !complaint.empty()) {
      result.push_back(std::move(complaint));
    }
  }
  return result;
}

}  // namespace tachless::campaign
