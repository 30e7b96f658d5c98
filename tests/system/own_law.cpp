// A controller program with laws of its own, for external_law_test.cpp: equation (15) under another
// name, and what a law can do wrong.

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstddef>
#include <cstdlib>
#include <string_view>
#include <vector>

#include "controller/law/loria_ortega_rigid.h"
#include "controller/law_socket.h"
#include "controller/program.h"

using namespace tachless;

namespace {

class OwnLaw : public controller::law::LoriaOrtegaRigid {
 public:
  static constexpr std::string_view name = "own_law";
  using LoriaOrtegaRigid::LoriaOrtegaRigid;

  [[nodiscard]] controller::law::Step<Memory> step(
      const Memory& memory, const Measurement& measurement,
      const messages::ReferencePoint& reference) const {
    auto result = LoriaOrtegaRigid::step(memory, measurement, reference);
    misbehave(result.command.tau);
    return result;
  }

 private:
  /// OWN_LAW says how; from the hundredth step on.
  void misbehave(Vector& tau) const {
    const char* variable = std::getenv("OWN_LAW");
    const std::string_view how = variable == nullptr ? "" : variable;
    if (how.empty() || ++steps_ < 100) return;
    if (how == "not finite") tau[0] = NAN;
    if (how == "kill") kill(getpid(), SIGKILL);
    if (how == "exit") _exit(7);
    if (how == "hang") {
      close(1);  // its output ends, the process does not
      close(2);
      pause();
    }
    if (how == "coarse") tau[0] = std::round(tau[0]);
    if (how == "other") tau[0] += 1e-9;
  }
  mutable int steps_ = 0;
};

/// Speaks the protocol by hand: announces STATE ("state"), sends NaN ("nan message"), or answers
/// every tick with the next one's number ("other tick").
int answer_by_hand(std::string_view how) {
  controller::LawSocket socket{base::FileDescriptor(3)};
  messages::Stamp stamp;
  messages::RunInfo run;
  socket.receive(messages::Codec<messages::RunInfo>(messages::Layout{}), stamp, run);
  messages::Participant self;
  self.role = messages::Role::controller;
  self.law = OwnLaw::name;
  self.measurement = how == "state" ? "STATE" : "POSITION";
  socket.send(messages::Codec<messages::Participant>(messages::Layout{}).encode(stamp, self));
  const int num_joints =
      scenario::parse_scenario(run.scenario, run.robot_description, "own_law").num_joints;
  const messages::Layout layout = messages::layout(num_joints, false, 0);
  messages::PositionMeasurement measurement;
  messages::ReferencePoint reference;
  messages::TorqueCommand command;
  command.tau = Vector::Zero(num_joints);
  while (
      socket.receive(messages::Codec<messages::PositionMeasurement>(layout), stamp, measurement) &&
      socket.receive(messages::Codec<messages::ReferencePoint>(layout), stamp, reference)) {
    if (how == "other tick") ++stamp.tick;
    messages::Codec<messages::TorqueCommand> codec(layout);
    const auto sound = codec.encode(stamp, command);
    std::vector<std::byte> bytes(sound.begin(), sound.end());
    if (how == "nan message") std::fill(bytes.end() - 8, bytes.end(), std::byte{0xff});
    socket.send(bytes);
    socket.send(messages::Codec<messages::LawSignals>(layout).encode(stamp, {}));
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  const char* variable = std::getenv("OWN_LAW");
  const std::string_view how = variable == nullptr ? "" : variable;
  if (how == "other tick" || how == "state" || how == "nan message") return answer_by_hand(how);
  return run_controller<OwnLaw>(argc, argv);
}
