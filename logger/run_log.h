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

/// A log as the run it recorded: messages decoded, grouped by tick, and what is missing named.
namespace tachless::logger {

using messages::Slot;
using messages::TickRecord;

/// Of the channel, after the robot's name.
inline constexpr std::string_view run_info_suffix = "_RUN_INFO";

/// A run that a log holds, and what its RUN_INFO says.
struct RunDescription {
  std::int64_t run_id = 0;      ///< of each of its messages
  messages::RunInfo info;       ///< the message
  scenario::Scenario scenario;  ///< read from the message's YAML
  messages::Layout layout;      ///< `num_signals` is how many signals RUN_INFO declares
};

/// Returns what a file without any message of a log is, by its beginning, and what to do.
std::string no_log_text(const std::filesystem::path& path);

/// Reads a RUN_INFO that came on `channel`. @param source names it in messages to people
/// @return what is wrong with it, after "its RUN_INFO"; empty: nothing, and `found` is filled
std::string read_run_info(std::string_view channel, std::span<const std::byte> data,
                          const std::string& source, RunDescription& found);

/// How often one message of a tick is in the log.
struct PieceSummary {
  std::string channel;           ///< its channel
  std::uint64_t count = 0;       ///< ticks that have it
  std::uint64_t duplicates = 0;  ///< further copies, the same
  std::uint64_t conflicts = 0;   ///< further copies, different: the first one counts
  TickRanges<100> missing;       ///< ticks up to the last that lack it

  /// A piece that the log never has was not recorded: absent, rather than full of gaps.
  [[nodiscard]] bool absent() const { return count == 0; }
};

/// A fault that a process announced.
struct ParticipantFault {
  messages::Role role = messages::Role::plant;  ///< of the process
  std::int64_t tick = 0;                        ///< when it was found
  std::string text;                             ///< cause
};

/// The instance in the announcement of a fault that `append_cause` writes; no process has it.
inline constexpr std::int64_t launcher_instance = 0;

/// Appends to the closed log of a run why the run ended: an announcement in the name of `role`, by
/// `launcher_instance`. It is the cause, whatever the processes have announced.
/// @throw base::Failure(bad_usage) when the log cannot be read or written
void append_cause(const std::filesystem::path& log, const scenario::Scenario& scenario,
                  std::int64_t run, const ParticipantFault& cause, base::ExitCode code);

/// Gains of the law that are not those of the tick before.
struct GainsSince {
  std::int64_t tick = 0;  ///< the first with them
  std::string gains;      ///< as scenario::gains_text; empty: the scenario's again
};

/// What was found on the way. Final once `RunLog::next` has returned false.
struct RunSummary {
  static constexpr std::size_t max_listed = 100;  ///< runs and faults

  std::int64_t first_tick = -1;                              ///< -1 while there is none
  std::int64_t last_tick = -1;                               ///< likewise
  std::uint64_t ticks = 0;                                   ///< ticks of which there is anything
  std::array<PieceSummary, messages::num_slots> pieces;      ///< by message of a tick
  std::map<messages::Rejection, std::uint64_t> undecodable;  ///< messages, by what is wrong
  std::uint64_t wrong_tick = 0;        ///< tick outside of the run, or at odds with
                                       ///< its time or its neighbours
  std::uint64_t too_late = 0;          ///< more than `RunLog::window` ticks out of order
  std::uint64_t foreign_messages = 0;  ///< of other runs of this robot
  std::map<std::int64_t, std::uint64_t> foreign_runs;  ///< the first `max_listed` of them
  std::vector<ParticipantFault> faults;                ///< the first `max_listed`, each once
  std::vector<GainsSince> gains;                       ///< changes; the first `max_listed`
  /// Why the run ended before its plan: the launcher's word, else the first fault of a member. Its
  /// tick is that of the first fault: the ticks after it belong to the stop.
  std::optional<ParticipantFault> stop;
  bool plant_finished = false;  ///< the plant announced that the run has reached its planned end

  /// One of `pieces`.
  [[nodiscard]] const PieceSummary& of(Slot piece) const { return pieces[index(piece)]; }
  /// Ticks that lack a piece, summed over the pieces that the log records: from 0 to the last
  /// tick, in realtime to the stop's.
  [[nodiscard]] std::uint64_t gaps() const;
  /// Returns why a run of `num_ticks` ended before its plan, as far as the log tells; empty: the
  /// run reached its planned end.
  [[nodiscard]] std::string stop_reason(std::int64_t num_ticks) const;
  /// "no ARM_TRUTH", "ARM_COMMAND missing in 3 ticks".
  [[nodiscard]] std::vector<std::string> gap_texts() const;
};

/// Reads a run from a log: a canonical one of ours, or one that lcm-logger recorded in order of
/// arrival, with duplicates and participants' messages. Front to back, in bounded memory: a
/// window of ticks. Gaps are named, never bridged.
class RunLog {
 public:
  /// Messages may be this many ticks out of order.
  static constexpr std::int64_t window = 128;

  /// Finds the run's RUN_INFO, wherever it is. With several runs in the log, `run` chooses; the
  /// first otherwise.
  /// @throw base::Failure(bad_usage) when the file cannot be read or holds no usable
  /// RUN_INFO (of that run): damaged, recorded by a version whose messages were others, or with a
  /// scenario that is not valid.
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
  /// What RUN_INFO has as YAML.
  [[nodiscard]] const scenario::Scenario& scenario() const { return described_.scenario; }

  /// The next tick of which the log holds anything, in order of ticks. False at the end.
  bool next(TickRecord& record);

  /// Calls `on_event` with every event of the log, of whatever channel, when `next` reads it.
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
