#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "logger/log_file.h"
#include "logger/tick_ranges.h"
#include "messages/truth/tick_record.h"
#include "messages/wire.h"
#include "scenario/scenario.h"

/// Reading of a log as a run. Messages are decoded and grouped by tick; gaps are named.
namespace tachless::logger {

using messages::Slot;
using messages::TickRecord;

/// Suffix of the channel of RUN_INFO, after the robot's name.
inline constexpr std::string_view run_info_suffix = "_RUN_INFO";

/// A run of a log, with the contents of its RUN_INFO.
struct RunDescription {
  std::int64_t run_id = 0;      ///< id in each message of the run
  messages::RunInfo info;       ///< the message
  scenario::Scenario scenario;  ///< read from the message's YAML
  messages::Layout layout;      ///< `num_signals` is the number of signals that RUN_INFO declares
};

/// Returns the kind of a file that is no log, judged by its first bytes, and a remedy.
std::string no_log_text(const std::filesystem::path& path);

/// Reads a RUN_INFO that came on `channel`.
/// @param source name of its file in messages to people
/// @return the problem, to be printed after "its RUN_INFO"; empty: none, and `found` is filled
std::string read_run_info(std::string_view channel, std::span<const std::byte> data,
                          const std::string& source, RunDescription& found);

/// Counts of one message of a tick in the log.
struct PieceSummary {
  std::string channel;           ///< channel of the message
  std::uint64_t count = 0;       ///< ticks that have it
  std::uint64_t duplicates = 0;  ///< further copies, the same
  std::uint64_t conflicts = 0;   ///< further copies, different: the first one counts
  TickRanges<100> missing;       ///< ticks up to the last that lack it

  /// Returns true if the log never has the piece. An absent piece has no gaps.
  [[nodiscard]] bool absent() const { return count == 0; }
};

/// A fault that a process announced.
struct ParticipantFault {
  messages::Role role = messages::Role::plant;  ///< role of the process
  std::int64_t tick = 0;                        ///< tick at which the process found the fault
  std::string text;                             ///< cause
};

/// The instance in the announcement of a fault that `append_cause` writes; no process has it.
inline constexpr std::int64_t launcher_instance = 0;

/// Appends the cause of the end to the closed log of a run. The cause is an announcement in the
/// name of `cause.role`, by `launcher_instance`. It outranks the announcements of the processes.
/// @throw base::Failure(bad_usage) when the log cannot be read or written
void append_cause(const std::filesystem::path& log, const scenario::Scenario& scenario,
                  std::int64_t run, const ParticipantFault& cause, base::ExitCode code);

/// Gains of the law that differ from the gains of the tick before.
struct GainsSince {
  std::int64_t tick = 0;  ///< the first with them
  std::string gains;  ///< gains in the form of scenario::gains_text; empty: the scenario's again
};

/// Findings of a RunLog. They are final once `RunLog::next` has returned false.
struct RunSummary {
  static constexpr std::size_t max_listed = 100;  ///< runs and faults

  std::int64_t first_tick = -1;                              ///< -1 while there is none
  std::int64_t last_tick = -1;                               ///< -1 while there is none
  std::uint64_t ticks = 0;                                   ///< ticks that have a message
  std::array<PieceSummary, messages::num_slots> pieces;      ///< summary of each message of a tick
  std::map<messages::Rejection, std::uint64_t> undecodable;  ///< messages, by what is wrong
  std::uint64_t wrong_tick = 0;        ///< tick outside the run, or contradicting
                                       ///< its time or its neighbours
  std::uint64_t too_late = 0;          ///< more than `RunLog::window` ticks out of order
  std::uint64_t foreign_messages = 0;  ///< messages of other runs of this robot
  std::map<std::int64_t, std::uint64_t> foreign_runs;  ///< the first `max_listed` of them
  std::vector<ParticipantFault> faults;                ///< the first `max_listed`, each once
  std::vector<GainsSince> gains;                       ///< changes; the first `max_listed`
  /// Cause of an end before the plan. The launcher's cause outranks the first fault of a member.
  /// Its tick is the tick of the first fault; later ticks belong to the stop.
  std::optional<ParticipantFault> stop;
  bool plant_finished = false;  ///< the plant announced that the run has reached its planned end

  /// Returns the summary of one piece.
  [[nodiscard]] const PieceSummary& of(Slot piece) const { return pieces[index(piece)]; }
  /// Returns the number of ticks that lack a piece, summed over the pieces that the log records.
  /// The ticks reach from 0 to the last tick, in realtime to the tick of the stop.
  [[nodiscard]] std::uint64_t gaps() const;
  /// Returns why a run of `num_ticks` ended before its plan, as far as the log shows; empty: the
  /// run reached its planned end.
  [[nodiscard]] std::string stop_reason(std::int64_t num_ticks) const;
  /// Returns texts such as "no ARM_TRUTH", "ARM_COMMAND missing in 3 ticks".
  [[nodiscard]] std::vector<std::string> gap_texts() const;
};

/// Reader of a run from a log, front to back. The log is canonical, or lcm-logger recorded it in
/// order of arrival, with duplicates and participants' messages. A window of ticks bounds the
/// memory. The reader names gaps and never bridges them.
class RunLog {
 public:
  /// Number of ticks that messages may be out of order.
  static constexpr std::int64_t window = 128;

  /// Finds the run's RUN_INFO anywhere in the log. Takes the run with id `run`, or without an id
  /// the first run.
  /// @throw base::Failure(bad_usage) when the file cannot be read or holds no usable RUN_INFO (of
  /// that run). A RUN_INFO is unusable if it is damaged, of another version's messages, or has an
  /// invalid scenario.
  static RunLog open(const std::filesystem::path& path, std::optional<std::int64_t> run = {}) {
    return RunLog(path, run);
  }
  RunLog(const RunLog&) = delete;
  RunLog& operator=(const RunLog&) = delete;
  ~RunLog();

  [[nodiscard]] const std::filesystem::path& path() const { return reader_.path(); }  ///< the file
  [[nodiscard]] const RunDescription& description() const { return described_; }   ///< of the run
  [[nodiscard]] std::int64_t run() const { return described_.run_id; }             ///< its id
  [[nodiscard]] const messages::RunInfo& info() const { return described_.info; }  ///< RUN_INFO
  /// Returns the scenario that RUN_INFO holds as YAML.
  [[nodiscard]] const scenario::Scenario& scenario() const { return described_.scenario; }

  /// Reads the next tick that has any message, in order of ticks. Returns false at the end.
  bool next(TickRecord& record);

  /// Makes `next` call `on_event` with every event that it reads, on any channel.
  void watch(std::function<void(const LogEvent&)> on_event) { on_event_ = std::move(on_event); }

  /// Starts over.
  void rewind();

  [[nodiscard]] const RunSummary& summary() const { return summary_; }     ///< so far
  [[nodiscard]] const Damage& damage() const { return reader_.damage(); }  ///< so far

 private:
  class Window;
  RunLog(const std::filesystem::path& path, std::optional<std::int64_t> run);

  LogReader reader_;
  RunDescription described_;
  RunSummary summary_;
  std::function<void(const LogEvent&)> on_event_;
  std::unique_ptr<Window> window_;
};

}  // namespace tachless::logger
