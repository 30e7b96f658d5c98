#include "controller/law_socket.h"

#include <fmt/format.h>
#include <poll.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <functional>
#include <memory>
#include <system_error>
#include <utility>

#include "base/child.h"
#include "base/clock.h"
#include "base/logging.h"
#include "scenario/gains.h"
#include "session/run_info.h"

namespace tachless::controller {
namespace {

using base::ExitCode;
using base::Failure;
using Clock = std::chrono::steady_clock;

/// Time for an interpreter and its packages to start on a busy machine.
constexpr std::chrono::seconds start_limit{30};
constexpr std::chrono::seconds end_limit{2};
constexpr std::int64_t no_tick = -1;

/// Codecs of the four messages of a tick.
struct Codecs {
  messages::Codec<messages::AnyMeasurement> measurement;
  messages::Codec<messages::ReferencePoint> reference;
  messages::Codec<messages::TorqueCommand> command;
  messages::Codec<messages::LawSignals> state;

  Codecs(std::string_view suffix, const messages::Layout& layout)
      : measurement(suffix, layout), reference(layout), command(layout), state(layout) {}
};

// ---- the process that computes the law --------------------------------------------------------

Failure no_message(std::string_view expected) {
  return {ExitCode::protocol_violated,
          "--serve: the message received is no {} message of this version", expected};
}

/// Answers each tick. At the first tick of a run it makes the law anew.
/// @return the RUN_INFO that came instead of a tick; empty if the other end is closed
std::span<const std::byte> answer(LawSocket& socket, const messages::Layout& layout,
                                  ScenarioLaw law, const std::function<ScenarioLaw()>& anew) {
  Codecs codecs(law->measurement(), layout);
  messages::Stamp stamp;
  messages::AnyMeasurement measurement;
  messages::ReferencePoint reference;
  for (std::int64_t last = no_tick;; last = stamp.tick) {
    const auto message = socket.receive();
    if (message.empty()) return {};
    if (codecs.measurement.decode(message, stamp, measurement) != messages::Rejection::none) {
      return message;
    }
    if (!socket.receive(codecs.reference, stamp, reference)) throw no_message("REFERENCE");
    if (stamp.tick <= last) law = anew();
    const Outcome outcome = law->step(stamp.tick, measurement, reference);
    if (!socket.send(codecs.command.encode(stamp, outcome.command)) ||
        !socket.send(codecs.state.encode(stamp, outcome.signals))) {
      return {};
    }
  }
}

// ---- the process that asks it -----------------------------------------------------------------

std::pair<base::FileDescriptor, base::FileDescriptor> socket_pair() {
  std::array<int, 2> ends{};
  if (socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, ends.data()) != 0) {
    throw std::system_error(errno, std::generic_category(), "socketpair");
  }
  return {base::FileDescriptor(ends[0]), base::FileDescriptor(ends[1])};
}

}  // namespace

/// The program that computes the law.
class Program {
 public:
  Program(const scenario::Scenario& scenario, std::string command)
      : command_(std::move(command)), socket_(base::FileDescriptor()) {
    auto [own, other] = socket_pair();
    // The shell moves its stdin, the socket, to descriptor 3, so that no reader of stdin consumes
    // it.
    base::StartOptions options;
    options.input = other.get();
    child_ = base::start({"/bin/sh", "-c", "exec 3<&0 </dev/null; exec " + command_ + " \"$@\"",
                          "sh", scenario.source, "--serve", "3"},
                         options);
    socket_ = LawSocket(std::move(own));
  }
  Program(const Program&) = delete;
  Program& operator=(const Program&) = delete;
  ~Program() { end(); }

  /// Sends the run to the program.
  /// @return the law that the program announces
  messages::LawInfo begin(const scenario::Scenario& scenario) {
    socket_.send(session::run_info(scenario, 1, {}));
    messages::Participant self;
    receive(messages::Codec<messages::Participant>(messages::Layout{}), no_tick, self, start_limit);
    if (!messages::parse_signals(self.signals) ||
        !messages::with_measurement(self.measurement, [](auto) {})) {
      throw Failure(ExitCode::protocol_violated,
                    "--controller '{}': announces the measurement \"{}\" and the signals \"{}\", "
                    "which this version does not know",
                    command_, self.measurement, self.signals);
    }
    scenario.require_law(self);  // refuses a measurement that the scenario does not name
    return self;
  }

  void ask(Codecs& codecs, std::int64_t tick, double period_s,
           const messages::AnyMeasurement& measurement, const messages::ReferencePoint& reference) {
    const messages::Stamp stamp{std::llround(static_cast<double>(tick) * period_s * 1e6), 1, tick};
    socket_.send(codecs.measurement.encode(stamp, measurement));
    socket_.send(codecs.reference.encode(stamp, reference));
  }
  /// Receives the program's answer to `ask`.
  /// @throw as `receive`
  void take(const Codecs& codecs, std::int64_t tick, Clock::duration limit,
            messages::TorqueCommand& command, messages::LawSignals& state) {
    receive(codecs.command, tick, command, limit);
    receive(codecs.state, tick, state, limit);
  }

 private:
  /// Receives the message of `tick` into `value`.
  /// @throw base::Failure: peer_lost after `limit`; protective_stop for a number that is not
  /// finite; protocol_violated for any other message that is no `Value` of this tick
  template <class Value>
  void receive(const messages::Codec<Value>& codec, std::int64_t tick, Value& value,
               Clock::duration limit) {
    wait(limit, tick);
    const auto message = socket_.receive();
    if (message.empty()) throw ended(tick);
    messages::Stamp stamp;
    const messages::Rejection why = codec.decode(message, stamp, value);
    if (why == messages::Rejection::non_finite) {
      throw Failure(ExitCode::protective_stop,
                    "--controller '{}': its torque {} is not finite: the loop is unstable; "
                    "shorten loop.period_s or soften the gains",
                    command_, when(tick));
    }
    if (why != messages::Rejection::none) {
      throw Failure(ExitCode::protocol_violated,
                    "--controller '{}': answered {} with a message that is {}", command_,
                    when(tick), messages::name(why));
    }
    if (stamp.tick != tick) {
      throw Failure(ExitCode::protocol_violated,
                    "--controller '{}': answered {} with a message of tick {}", command_,
                    when(tick), stamp.tick);
    }
  }

  static std::string when(std::int64_t tick) {
    return tick == no_tick ? "at the start" : fmt::format("at tick {}", tick);
  }

  /// Waits for one of the descriptors.
  /// @return false if the time is over
  static bool poll_until(Clock::time_point until, std::span<pollfd> fds) {
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(until - Clock::now());
    if (left.count() < 0) return false;
    poll(fds.data(), fds.size(), static_cast<int>(left.count()));
    return true;
  }

  /// Waits until a message can be received; meanwhile it passes the program's output on to stderr.
  void wait(Clock::duration limit, std::int64_t tick) {
    const auto until = Clock::now() + limit;
    for (;;) {
      std::array<pollfd, 2> fds{pollfd{socket_.descriptor(), POLLIN, 0},
                                pollfd{child_.output.get(), POLLIN, 0}};
      if (!poll_until(until, fds)) break;
      if (fds[1].revents != 0) base::read_lines(child_, print_line);
      if (fds[0].revents != 0) return;
    }
    throw Failure(ExitCode::peer_lost,
                  "--controller '{}': no answer {} within {:g} s; see its output", command_,
                  when(tick), std::chrono::duration<double>(limit).count());
  }

  static void print_line(const std::string& line) { base::pass_on(line); }

  /// Closes the socket, upon which the program ends, and waits for its end.
  /// @return how the program ended
  base::End end() {
    if (!child_.running) return {};
    socket_.close();
    return base::end_within(child_, end_limit, print_line);
  }

  Failure ended(std::int64_t tick) {
    const base::End end = this->end();
    const int code = end.exit_code;
    // A shell exits with 126 or 127, and an interpreter with 1, if the program does not exist.
    const bool absent = tick == no_tick && (code == 1 || code == 126 || code == 127);
    const bool ours = code >= static_cast<int>(ExitCode::check_said_no) &&
                      code <= static_cast<int>(ExitCode::protective_stop);
    const char* const remedy = end.well() ? "; does its main call run_controller?" : "";
    return {absent ? ExitCode::bad_usage
            : ours ? static_cast<ExitCode>(code)
                   : ExitCode::peer_lost,
            "--controller '{}': {} {}{}",
            command_,
            base::text(end),
            when(tick),
            remedy};
  }

  std::string command_;
  LawSocket socket_;
  base::Child child_;
};

namespace {

class ExternalLaw final : public AnyLaw {
 public:
  ExternalLaw(std::unique_ptr<Program> program, messages::LawInfo info,
              const scenario::Scenario& scenario)
      : AnyLaw(scenario.loop),
        program_(std::move(program)),
        info_(std::move(info)),
        signals_(messages::parse_signals(info_.signals).value()),
        period_s_(scenario.loop.period_s),
        limit_(base::nanoseconds_of(scenario.loop.give_up_s)),
        codecs_(info_.measurement, law_layout(scenario, *this)) {}

  [[nodiscard]] std::string_view name() const override { return info_.law; }
  [[nodiscard]] std::string_view measurement() const override { return info_.measurement; }
  [[nodiscard]] std::span<const messages::Signal> signals() const override { return signals_; }

 private:
  /// Does nothing: the program retunes its law by the reference it receives.
  void build(std::string_view /*gains*/) override {}
  /// Asks the program, which counts the ticks between two measurements itself.
  void compute(std::int64_t tick, const messages::AnyMeasurement& measurement,
               const messages::ReferencePoint& reference, int /*ticks*/) override {
    program_->ask(codecs_, tick, period_s_, measurement, reference);
    program_->take(codecs_, tick, limit_, command_, signals_of_step_);
  }

  std::unique_ptr<Program> program_;
  messages::LawInfo info_;
  std::vector<messages::Signal> signals_;  ///< views into `info_`
  double period_s_;
  Clock::duration limit_;
  Codecs codecs_;
};

/// Returns the overrides that give the scenario this period and these gains. `gains` has the form
/// of scenario::gains_text; an empty text keeps the scenario's gains.
std::vector<std::string> changes(const scenario::Scenario& scenario, double period_s,
                                 const std::string& gains) {
  std::vector<std::string> all;
  if (period_s != scenario.loop.period_s) {
    all = {fmt::format("loop.period_s={:.17g}", period_s),
           fmt::format("loop.duration_s={:.17g}", 10 * period_s)};
  }
  if (gains.empty() || gains == scenario::gains_text(scenario.controller.gains)) return all;
  for (const auto& [name, value] : with_gains(scenario, gains).controller.gains) {
    if (value.size() > scenario.num_joints) continue;  // skips matrices, which no caller changes
    all.push_back(fmt::format("controller.gains.{}=[{}]", name, fmt::join(value, ", ")));
  }
  return all;
}

}  // namespace

bool LawSocket::send(std::span<const std::byte> message) {
  ssize_t sent = -1;
  do {
    sent = ::send(socket_.get(), message.data(), message.size(), MSG_NOSIGNAL);
  } while (sent < 0 && errno == EINTR);
  return sent == static_cast<ssize_t>(message.size());
}

std::span<const std::byte> LawSocket::receive() {
  ssize_t got = -1;
  do {  // A peer that closed with unread messages causes one ECONNRESET before the messages it had
        // sent.
    got = ::recv(socket_.get(), buffer_.data(), buffer_.size(), 0);
  } while (got < 0 && (errno == EINTR || errno == ECONNRESET));
  return std::span(buffer_).first(static_cast<std::size_t>(std::max<ssize_t>(got, 0)));
}

void serve_law(int socket, const MakeLaw& make_law) {
  LawSocket caller{base::FileDescriptor(socket)};
  auto message = caller.receive();
  std::string expected = "RUN_INFO";
  do {
    messages::Stamp stamp;
    messages::RunInfo run;
    const messages::Codec<messages::RunInfo> codec(messages::Layout{});
    if (codec.decode(message, stamp, run) != messages::Rejection::none) throw no_message(expected);
    const scenario::Scenario scenario =
        scenario::parse_scenario(run.scenario, run.robot_description, "--serve");
    ScenarioLaw law = make_law(scenario);
    messages::Participant self;
    static_cast<messages::LawInfo&>(self) = law_info(*law);
    self.role = messages::Role::controller;
    if (!caller.send(
            messages::Codec<messages::Participant>(messages::Layout{}).encode(stamp, self)))
      return;
    const messages::Layout layout = law_layout(scenario, *law);
    expected = law->measurement();
    message = answer(caller, layout, std::move(law), [&] { return make_law(scenario); });
  } while (!message.empty());
}

ScenarioLaw external_law(const scenario::Scenario& scenario, const std::string& command) {
  auto program = std::make_unique<Program>(scenario, command);
  messages::LawInfo info = program->begin(scenario);
  return std::make_unique<ExternalLaw>(std::move(program), std::move(info), scenario);
}

LawProgram::LawProgram(const scenario::Scenario& scenario, const std::string& command)
    : scenario_(scenario),
      program_(std::make_shared<Program>(scenario, command)),
      info_(program_->begin(scenario)) {}

std::vector<Vector> LawProgram::answers(double period_s, Gravity gravity,
                                        std::span<const messages::AnyMeasurement> measurements,
                                        const messages::ReferencePoint& reference) {
  // Ticks sent ahead of their answers; far below the capacity of a socket.
  constexpr std::size_t under_way = 16;
  const std::lock_guard lock(mutex_);
  if (failure_) std::rethrow_exception(failure_);
  try {
    std::vector<std::string> other = changes(scenario_, period_s, reference.gains);
    // A tiny gravity instead of zero: a scenario whose arm compensates gravity itself refuses zero.
    if (gravity == Gravity::nearly_zero) other.emplace_back("robot.gravity_m_per_s2=1e-9");
    if (other != begun_) {
      scenario::Scenario scenario = scenario::parse_scenario(
          scenario_.text, scenario_.robot.urdf_text, scenario_.source, other);
      scenario.loop.period_s = period_s;
      info_ = program_->begin(scenario);
      begun_ = std::move(other);
    }
    const auto limit = base::nanoseconds_of(scenario_.loop.give_up_s);
    const auto signals = messages::parse_signals(info_.signals).value();
    Codecs codecs(info_.measurement,
                  messages::layout(scenario_.num_joints, scenario_.robot.flexible.has_value(),
                                   static_cast<int>(signals.size())));
    messages::ReferencePoint held = reference;
    held.gains.clear();  // an empty text selects the scenario's gains
    std::vector<Vector> torques;
    for (std::size_t sent = 0; torques.size() < measurements.size();) {
      for (; sent < std::min(torques.size() + under_way, measurements.size()); ++sent) {
        program_->ask(codecs, static_cast<std::int64_t>(sent), period_s, measurements[sent], held);
      }
      while (torques.size() < sent) {
        messages::TorqueCommand command;
        messages::LawSignals state;
        program_->take(codecs, static_cast<std::int64_t>(torques.size()), limit, command, state);
        torques.push_back(command.tau);
      }
    }
    return torques;
  } catch (...) {
    failure_ = std::current_exception();
    throw;
  }
}

std::vector<std::string> shell_command(const std::string& command,
                                       const std::vector<std::string>& arguments) {
  std::vector<std::string> words = {"/bin/sh", "-c", "exec " + command + " \"$@\"", "sh"};
  words.insert(words.end(), arguments.begin(), arguments.end());
  return words;
}

}  // namespace tachless::controller
