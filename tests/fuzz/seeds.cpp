// Writes valid inputs from which a fuzzer starts: fuzz_seeds wire_fuzzer|log_fuzzer DIRECTORY

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <span>
#include <string>
#include <vector>

#include "logger/log_file.h"
#include "messages/truth/truth_wire.h"
#include "messages/wire.h"
#include "tests/fuzz/message_list.h"

using namespace tachless;

namespace {

constexpr messages::Layout layout{.num_joints = 2, .num_motors = 0, .num_signals = 2};
constexpr std::int64_t num_ticks = 3;

struct Message {
  int type;  ///< number of the type in message_list.h
  std::string channel;
  std::vector<std::byte> bytes;
  std::int64_t utime;
};

template <class Value>
void add(std::vector<Message>& messages, const Value& value, std::int64_t tick) {
  messages::Codec<Value> codec(layout);
  const std::int64_t utime = tick < 0 ? 0 : tick * 1000;
  const auto bytes = codec.encode({utime, 7, tick}, value);
  messages.push_back({fuzz::number_of<Value>(),
                      messages::channel<Value>("ARM"),
                      {bytes.begin(), bytes.end()},
                      utime});
}

std::string contents(const std::filesystem::path& path) {
  std::ifstream file(path);
  return {std::istreambuf_iterator<char>(file), {}};
}

/// Returns the messages of one run. The log's messages come first, in its order.
std::vector<Message> sample_messages() {
  std::vector<Message> all;
  messages::RunInfo info;
  info.num_ticks = num_ticks;
  info.period_s = 1e-3;
  info.version = "1.0";
  info.robot = "ARM";
  info.measurement = "POSITION";
  info.signals = "error:rad,nu:rad/s";
  info.scenario = contents(TACHLESS_SOURCE_DIR "/scenarios/practical_rigid.yaml");
  info.scenario += "  # as it is in a log: with what the command line gave\n";
  const std::string duration = "duration_s: 5.0";
  info.scenario.replace(info.scenario.find(duration), duration.size(), "duration_s: 0.003");
  info.robot_description = contents(TACHLESS_SOURCE_DIR "/scenarios/robots/two_link.urdf");
  add(all, info, -1);
  const Vector x = Vector::Constant(2, 0.5);
  for (std::int64_t k = 0; k < num_ticks; ++k) {
    add(all, messages::Tick{k + 1 == num_ticks}, k);
    add(all, messages::PositionMeasurement{x}, k);
    add(all, messages::ReferencePoint{x, x, x, x, x}, k);
    add(all, messages::TorqueCommand{x}, k);
    messages::LawSignals state;
    state.num = 2;
    state.value[0] = state.value[1] = x;
    add(all, state, k);
    messages::truth::PlantTruth truth;
    truth.q = truth.v = truth.tau = truth.disturbance = x;
    add(all, truth, k);
    add(all, messages::truth::Contact{"MuJoCo 2.2.2", "tip, wall", 5}, k);
    add(all, messages::truth::ArmTorque{x, x}, k);
  }
  messages::Participant participant;
  participant.instance = 5;
  participant.host = "host";
  participant.scenario = "practical_rigid";
  participant.measurement = "POSITION";
  participant.signals = "error:rad,nu:rad/s";
  participant.fault = "fault";
  add(all, participant, 2);
  participant.role = messages::Role::controller;
  participant.law = "a law";
  participant.roster = {5, 6, 7, 8};
  add(all, participant, 3);
  add(all, messages::LogAck{5}, 2);
  add(all, messages::GainChange{"kp=1,2", "kp=3", 6, 7}, 2);
  add(all, messages::GainAck{7}, 3);
  return all;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) return 2;
  const std::filesystem::path directory = argv[2];
  if (std::string(argv[1]) == "log_fuzzer") {
    logger::LogWriter log(directory / "seed");
    for (const Message& each : sample_messages()) {
      log.append(each.utime, each.channel, each.bytes);
    }
    log.close();
    return 0;
  }
  int number = 0;
  for (const Message& each : sample_messages()) {
    std::ofstream file(directory / std::to_string(number++), std::ios::binary);
    file.put(static_cast<char>(each.type));
    file.write(reinterpret_cast<const char*>(each.bytes.data()),
               static_cast<std::streamsize>(each.bytes.size()));
  }
}
