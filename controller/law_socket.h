#pragma once

#include <cstddef>
#include <exception>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <vector>

#include "base/file_descriptor.h"
#include "controller/registry.h"
#include "messages/wire.h"

/// A law in another process of this machine, asked over a pair of sockets instead of the bus: the
/// caller sends RUN_INFO and is told the law (PARTICIPANT); then for each tick it sends measurement
/// and reference, and is sent command and state. The messages are those of the bus; whoever
/// computes the law gets these and nothing else.
namespace tachless::controller {

/// One end. Messages keep their limits (SOCK_SEQPACKET).
class LawSocket {
 public:
  explicit LawSocket(base::FileDescriptor socket) : socket_(std::move(socket)) {}

  [[nodiscard]] int descriptor() const { return socket_.get(); }
  void close() { socket_ = base::FileDescriptor(); }

  /// Sends a message. @return whether the other end is still there
  bool send(std::span<const std::byte> message);

  /// Waits for a message, which is valid until the next call; empty when the other end is closed.
  std::span<const std::byte> receive();

  /// Waits for a message. @return whether it is one of `Value`
  template <class Value>
  bool receive(const messages::Codec<Value>& codec, messages::Stamp& stamp, Value& value) {
    const auto message = receive();
    return !message.empty() && codec.decode(message, stamp, value) == messages::Rejection::none;
  }

 private:
  base::FileDescriptor socket_;
  std::vector<std::byte> buffer_ = std::vector<std::byte>(messages::max_run_info_size);
};

/// Answers on the descriptor `socket`, which becomes its own, until the other end is closed. A
/// RUN_INFO after the first one, or a tick that is not later than the last, begins a run anew.
/// @throw base::Failure bad_usage (scenario, law), protective_stop (a torque that is not
/// finite), protocol_violated (what came is no message)
void serve_law(int socket, const MakeLaw& make_law);

/// The law that the program `command` computes, which is started here and ends with the law.
/// `command` is what would be typed in a shell; the program has `serve_law` behind the option
/// --serve, as all have whose main is `tachless::run_controller`. What it writes goes to stderr.
/// @throw base::Failure naming the command: bad_usage (it cannot be started, or does not
/// say what it needs), later at a step its own code when it ends, peer_lost when it does not
/// answer within loop.give_up_s
ScenarioLaw external_law(const scenario::Scenario& scenario, const std::string& command);

class Program;

/// The same program asked again and again what its law commands: without a run, from any thread.
class LawProgram {
 public:
  /// @throw base::Failure as `external_law`
  LawProgram(const scenario::Scenario& scenario, const std::string& command);

  /// Returns the name that the law announces.
  [[nodiscard]] const std::string& law() const { return info_.law; }

  /// Its torques [N m] for these measurements, tick by tick from 0 of a run at that period that
  /// begins here, the reference held and its gains the scenario's; `weightless`: without gravity.
  /// @throw base::Failure as a step of `external_law`; from then on the same at each call,
  /// for answers may be under way that nobody has taken
  std::vector<Vector> answers(double period_s, bool weightless,
                              std::span<const messages::AnyMeasurement> measurements,
                              const messages::ReferencePoint& reference);

 private:
  scenario::Scenario scenario_;
  std::shared_ptr<Program> program_;
  messages::LawInfo info_;
  std::vector<std::string> begun_;  ///< by what the run that has begun differs
  std::mutex mutex_;
  std::exception_ptr failure_;
};

/// Returns the words that start `command` with further arguments in a shell.
std::vector<std::string> shell_command(const std::string& command,
                                       const std::vector<std::string>& arguments);

}  // namespace tachless::controller
