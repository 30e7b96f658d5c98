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
#include "node/session.h"
#include "protocol/lockstep/verdict.h"

namespace tachless::logger {

/// The recording process, but for what the two modes do unlike: meets the others, hears RUN_INFO
/// and checks everything before it goes on; closes the log in every case.
class Recorder {
 public:
  Recorder(const experiment::Scenario& scenario, bus::Transport& transport, node::Session& session,
           const std::filesystem::path& log_path);
  Recorder(const Recorder&) = delete;
  Recorder& operator=(const Recorder&) = delete;
  virtual ~Recorder() = default;

  void run();

 protected:
  using Slot = loop::Slot;

  /// Another copy of RUN_INFO, or the first.
  virtual protocol::lockstep::Verdict on_run_info(bool same) = 0;
  virtual void on_message(Slot slot, const loop::Stamp& stamp, const bus::Datagram& datagram) = 0;
  /// One of the session's own.
  virtual void on_participant(const bus::Datagram& datagram) = 0;
  /// Something was taken: what is due to be written or acknowledged?
  virtual void after_message() = 0;
  /// The plant has finished, or (not `well`) the run has failed: takes what still comes.
  virtual void conclude(bool well) = 0;

  /// One message of this recorder's, if any comes before the deadline. @return whether one did
  bool receive(loop::Clock::time_point deadline);

  void append(std::int64_t utime, std::string_view channel, std::span<const std::byte> data);
  void acknowledge(std::int64_t tick, std::uint64_t missing);
  /// Counts a message that is not new. @throw diagnostics::Failure(protocol_violated) if it
  /// contradicts.
  void count(protocol::lockstep::Verdict verdict, Slot slot, std::int64_t tick,
             std::string_view first, std::string_view second);

  RunMessages& messages() { return messages_; }
  node::Session& session() { return session_; }
  LogWriter& file() { return file_; }

 private:
  void take(const bus::Datagram& datagram);
  void hear_run_info(const bus::Datagram& datagram);
  /// The run has failed: what has arrived already still belongs into the log.
  void save_the_rest(const diagnostics::Failure& cause);

  bus::Transport& transport_;
  node::Session& session_;
  RunMessages messages_;
  std::string run_info_channel_;
  std::string ack_channel_;
  bus::Codec<loop::RunInfo> run_info_codec_;
  bus::Codec<loop::LogAck> ack_codec_;
  LogWriter file_;
  std::vector<std::byte> run_info_;
  std::string run_info_sender_;
};

}  // namespace tachless::logger
