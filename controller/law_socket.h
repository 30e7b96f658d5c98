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

/// A law in another process of this machine, which answers over a pair of sockets instead of the
/// bus. The caller sends RUN_INFO and receives the law's PARTICIPANT. For each tick the caller then
/// sends measurement and reference, and receives command and state. The messages have the bus's
/// format. The program that computes the law receives only these messages.
namespace tachless::controller {

/// One end of the pair. Message boundaries are kept (SOCK_SEQPACKET).
class LawSocket {
 public:
  explicit LawSocket(base::FileDescriptor socket) : socket_(std::move(socket)) {}

  [[nodiscard]] int descriptor() const { return socket_.get(); }
  void close() { socket_ = base::FileDescriptor(); }

  /// Sends a message.
  /// @return false if the other end is closed
  bool send(std::span<const std::byte> message);

  /// Waits for a message and returns it. The message is valid until the next call; it is empty if
  /// the other end is closed.
  std::span<const std::byte> receive();

  /// Waits for a message.
  /// @return whether the message is a `Value`
  template <class Value>
  bool receive(const messages::Codec<Value>& codec, messages::Stamp& stamp, Value& value) {
    const auto message = receive();
    return !message.empty() && codec.decode(message, stamp, value) == messages::Rejection::none;
  }

 private:
  base::FileDescriptor socket_;
  std::vector<std::byte> buffer_ = std::vector<std::byte>(messages::max_run_info_size);
};

/// Answers on the descriptor `socket` until the other end is closed. Takes ownership of the
/// descriptor. A RUN_INFO after the first one starts a new run. A tick that is not later than the
/// last one also starts a new run.
/// @throw base::Failure: bad_usage (scenario, law), protective_stop (a torque that is not finite),
/// protocol_violated (a message of another kind)
void serve_law(int socket, const MakeLaw& make_law);

/// Starts the program `command` and returns the law that it computes. The program ends with the
/// law. `command` is a shell command. The program calls `serve_law` for the option --serve, as
/// every program with `tachless::run_controller` does. The program's output goes to stderr.
/// @throw base::Failure naming the command: bad_usage if the program cannot be started or does not
/// name a measurement that the scenario allows. A step throws a Failure with the program's own exit
/// code when the program ends, and peer_lost when no answer comes within loop.give_up_s.
ScenarioLaw external_law(const scenario::Scenario& scenario, const std::string& command);

class Program;

/// Gravity with which a law is asked for torques.
enum class Gravity { of_scenario, nearly_zero };

/// A program that is asked repeatedly for its law's torques, without a run, from any thread.
class LawProgram {
 public:
  /// @throw base::Failure as `external_law`
  LawProgram(const scenario::Scenario& scenario, const std::string& command);

  /// Returns the name that the law announces.
  [[nodiscard]] const std::string& law() const { return info_.law; }

  /// Returns the law's torques [N m] for these measurements, which belong to ticks 0, 1, … of a new
  /// run with this period. The reference is held, and the gains are the scenario's.
  /// @throw base::Failure as a step of `external_law`. Every later call throws the same failure,
  /// because unread answers may still be in the socket.
  std::vector<Vector> answers(double period_s, Gravity gravity,
                              std::span<const messages::AnyMeasurement> measurements,
                              const messages::ReferencePoint& reference);

 private:
  scenario::Scenario scenario_;
  std::shared_ptr<Program> program_;
  messages::LawInfo info_;
  std::vector<std::string> begun_;  ///< overrides of the current run
  std::mutex mutex_;
  std::exception_ptr failure_;
};

/// Returns the words that start `command` with further arguments in a shell.
std::vector<std::string> shell_command(const std::string& command,
                                       const std::vector<std::string>& arguments);

}  // namespace tachless::controller
