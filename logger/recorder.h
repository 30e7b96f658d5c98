#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "bus/transport.h"
#include "bus/wire.h"
#include "experiment/scenario.h"
#include "logger/log_file.h"
#include "logger/run_messages.h"
#include "node/link.h"
#include "node/session.h"
#include "protocol/lockstep/message_ring.h"

namespace tachless::logger {

/// What recording has in common in both modes: joins, checks every message of the run before it
/// goes on, takes RUN_INFO, closes the log in every case. The log of a run that has failed ends
/// with the announcement of the fault that ended it: a member's, or this process's own. Does not
/// know which message is due.
class Recorder {
 public:
  Recorder(const experiment::Scenario& scenario, bus::Transport& transport, node::Link& link,
           const std::filesystem::path& log_path);
  Recorder(const Recorder&) = delete;
  Recorder& operator=(const Recorder&) = delete;
  virtual ~Recorder() = default;

  void run();

 protected:
  using Slot = loop::Slot;

  /// Another copy of RUN_INFO, or the first.
  virtual protocol::lockstep::Verdict take_run_info(bool same) = 0;
  virtual void on_message(Slot slot, const loop::Stamp& stamp, const bus::Datagram& datagram) = 0;
  /// A participant's announcement.
  virtual void on_participant(const bus::Datagram& /*datagram*/) {}
  /// A message has been handled: writes and acknowledges what is due.
  virtual void after_message() = 0;
  /// Whether every tick has come, or is never to come.
  [[nodiscard]] virtual bool complete(loop::Clock::time_point now) const = 0;
  /// The plant has finished, or (not `well`) the run has failed: records what still comes.
  virtual void conclude(bool well) = 0;
  /// The time of an event that belongs to no tick.
  [[nodiscard]] virtual std::int64_t utime() const = 0;

  /// As Loop::count; but once the run has failed a conflict is no news: what comes is recorded.
  template <class FirstSender>
  void count(protocol::lockstep::Verdict verdict, loop::Role from, const bus::Datagram& datagram,
             std::int64_t tick, FirstSender first_sender) {
    if (concluding_) return loop_.count(verdict);
    loop_.count(verdict, from, datagram, tick, first_sender);
  }
  void append(std::int64_t utime, std::string_view channel, std::span<const std::byte> data);
  void acknowledge(std::int64_t tick, std::uint64_t missing);
  /// Who publishes the messages of a slot.
  static loop::Role role_of(Slot slot);

  [[nodiscard]] bool concluding() const { return concluding_; }
  RunMessages& messages() { return messages_; }
  node::Link& link() { return link_; }
  LogWriter& file() { return file_; }
  node::Loop& loop() { return loop_; }

 private:
  void on_run_info(const bus::Datagram& datagram);
  void on_slot(Slot slot, const bus::Datagram& datagram);
  void record(Slot slot);
  void keep_fault(const bus::Datagram& announcement);
  void save_the_rest(const diagnostics::Failure& cause);
  void record_end(const diagnostics::Failure& cause);

  bus::Transport& transport_;
  node::Link& link_;
  node::Loop loop_;
  RunMessages messages_;
  std::string ack_channel_;
  bus::Codec<loop::RunInfo> run_info_codec_;
  bus::Codec<loop::LogAck> ack_codec_;
  bus::Codec<loop::Participant> participant_codec_;
  LogWriter file_;
  std::vector<std::byte> run_info_;
  std::string run_info_sender_;
  bool concluding_ = false;       ///< the run has failed
  bool whole_ = false;            ///< every tick is on the disk
  std::vector<std::byte> fault_;  ///< announcement of the member's fault that has ended it, if any
};

}  // namespace tachless::logger
