#include "controller/law_socket.h"

#include <fmt/core.h>
#include <sys/socket.h>

#include <algorithm>
#include <cerrno>
#include <memory>
#include <utility>
#include <variant>

#include "controller/law_stepper.h"

namespace tachless::controller {
namespace {

diagnostics::Failure no_message(std::string_view expected) {
  return {diagnostics::ExitCode::protocol_violated,
          fmt::format("--serve: what came is no {} message of this version", expected)};
}

template <class Measurement>
void answer(LawSocket& socket, const experiment::Scenario& scenario, const loop::Layout& layout,
            std::unique_ptr<AnyLaw<Measurement>> law) {
  const bus::Codec<Measurement> measurement_codec(layout);
  const bus::Codec<loop::ReferencePoint> reference_codec(layout);
  bus::Codec<loop::TorqueCommand> command_codec(layout);
  bus::Codec<loop::LawSignals> state_codec(layout);
  LawStepper<Measurement> stepper(std::move(law), scenario.loop);
  Measurement measurement;
  loop::ReferencePoint reference;
  for (;;) {
    const auto message = socket.receive();
    if (message.empty()) return;
    loop::Stamp stamp;
    if (measurement_codec.decode(message, stamp, measurement) != bus::Rejection::none) {
      throw no_message(loop::MessageOf<Measurement>::suffix);
    }
    if (!socket.receive(reference_codec, stamp, reference)) throw no_message("REFERENCE");
    const auto output = stepper.step(stamp.tick, measurement, reference).output;
    if (!bus::all_finite(output.command) || !bus::all_finite(output.signals)) {
      throw not_finite(stepper.law().name(), output.command.tau, stamp.tick);
    }
    stepper.keep(stamp.tick);
    if (!socket.send(command_codec.encode(stamp, output.command)) ||
        !socket.send(state_codec.encode(stamp, output.signals))) {
      return;
    }
  }
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
  do {
    got = ::recv(socket_.get(), buffer_.data(), buffer_.size(), 0);
  } while (got < 0 && errno == EINTR);
  return std::span(buffer_).first(static_cast<std::size_t>(std::max<ssize_t>(got, 0)));
}

void serve_law(int socket, const MakeLaw& make_law) {
  LawSocket caller{process::FileDescriptor(socket)};
  loop::Stamp stamp;
  loop::RunInfo run;
  if (!caller.receive(bus::Codec<loop::RunInfo>(loop::Layout{}), stamp, run)) {
    throw no_message("RUN_INFO");
  }
  const experiment::Scenario scenario =
      experiment::parse_scenario(run.scenario, run.robot_description, "--serve");
  ScenarioLaw law = make_law(scenario);
  const loop::LawInfo info = law_info(law);
  loop::Participant self;
  self.role = loop::Role::controller;
  self.law = info.name;
  self.measurement = info.measurement;
  self.signals = info.signals;
  if (!caller.send(bus::Codec<loop::Participant>(loop::Layout{}).encode(stamp, self))) return;
  const loop::Layout layout = law_layout(scenario, law);
  std::visit([&](auto own) { answer(caller, scenario, layout, std::move(own)); }, std::move(law));
}

}  // namespace tachless::controller
