#include <gmock/gmock.h>

#include <limits>
#include <string>
#include <tachless/participant_t.hpp>
#include <tachless/run_info_t.hpp>
#include <tachless/tick_t.hpp>

#include "messages/wire.h"
#include "tests/core/messages/codec_checks.h"

namespace tachless::messages {
namespace {

using codec_checks::body;
using codec_checks::Bytes;
using codec_checks::sample;
using codec_checks::verdict;
using TickType = codec_checks::Pair<messages::Tick, tachless::tick_t>;
using ParticipantType = codec_checks::Pair<messages::Participant, tachless::participant_t>;
using RunInfoType = codec_checks::Pair<messages::RunInfo, tachless::run_info_t>;

// Offsets inside participant_t.
constexpr std::size_t participant_role = body;  // length of the text; it is "controller"
constexpr std::size_t participant_state = participant_role + 4 + 11;
constexpr std::size_t participant_error_norm = participant_state + 1;

/// A message in which `bytes` replace the bytes at `at`, and the expected verdict.
struct Altered {
  const char* what;
  Rejection (*verdict)(const messages::Layout&, std::span<const std::byte>);
  Bytes message;
  std::size_t at;
  std::vector<int> bytes;
  Rejection expected = Rejection::bad_value;
};

TEST(Codecs, RejectSingleFieldsOutsideTheirRange) {
  constexpr auto tick = verdict<TickType>;
  constexpr auto participant = verdict<ParticipantType>;
  constexpr auto run_info = verdict<RunInfoType>;
  const Bytes a_tick = sample<TickType>({}), announced = sample<ParticipantType>({}),
              a_run_info = sample<RunInfoType>({});
  const auto text = Rejection::bad_text;
  const std::size_t last = a_tick.size() - 1, role = participant_role, version = body + 16;
  const std::vector<int> zeros(8, 0);
  const std::vector<Altered> all = {
      {"flag 0", tick, a_tick, last, {0}, Rejection::none},
      {"flag 1", tick, a_tick, last, {1}, Rejection::none},
      {"flag 2", tick, a_tick, last, {2}},
      {"flag 255", tick, a_tick, last, {255}},
      {"utime -1", participant, announced, 8, std::vector<int>(8, 255)},
      {"utime 9e15",
       participant,
       announced,
       8,
       {0, 0x1f, 0xf9, 0x73, 0xca, 0xfa, 0x80, 0},
       Rejection::none},
      {"utime 9e15 + 1", participant, announced, 8, {0, 0x1f, 0xf9, 0x73, 0xca, 0xfa, 0x80, 0x1}},
      {"state 5", participant, announced, participant_state, {5}},
      {"state 255", participant, announced, participant_state, {255}},
      {"error -1", participant, announced, participant_error_norm, {0xbf, 0xf0, 0, 0, 0, 0, 0, 0}},
      {"role Controller", participant, announced, role + 4, {'C'}},
      // "controller" has 11 characters with its NUL.
      {"length 0", participant, announced, role, {0, 0, 0, 0}, text},
      {"length -1", participant, announced, role, {255, 255, 255, 255}, text},
      {"length -2^31", participant, announced, role, {0x80, 0, 0, 0}, text},
      {"length 2^31-1", participant, announced, role, {0x7f, 255, 255, 255}, text},
      {"length 2^29", participant, announced, role, {0x20, 0, 0, 0}, text},
      {"length 1026", participant, announced, role, {0, 0, 4, 2}, text},
      {"length 10", participant, announced, role, {0, 0, 0, 10}, text},
      {"length 12", participant, announced, role, {0, 0, 0, 12}, text},
      {"no NUL", participant, announced, role + 4 + 10, {'x'}, text},
      {"NUL inside", participant, announced, role + 4 + 3, {0}, text},
      {"no ticks", run_info, a_run_info, body, zeros},
      {"no period", run_info, a_run_info, body + 8, zeros},
      // "version" has 8.
      {"length 7", run_info, a_run_info, version, {0, 0, 0, 7}, text},
      {"length 9", run_info, a_run_info, version, {0, 0, 0, 9}, text},
      {"length 1000", run_info, a_run_info, version, {0, 0, 3, 0xe8}, text}};
  for (const Altered& each : all) {
    Bytes bytes = each.message;
    for (std::size_t i = 0; i < each.bytes.size(); ++i) {
      bytes.at(each.at + i) = static_cast<std::byte>(each.bytes[i]);
    }
    EXPECT_EQ(each.verdict({}, bytes), each.expected) << each.what;
  }
}

TEST(ParticipantCodec, RejectsNonFiniteErrorNorm) {
  codec_checks::rejects_non_finite<ParticipantType>(participant_error_norm, 1, {});
}
// A line end in a signal's name would be a command to gnuplot. A control character in any name
// would be an order to a terminal.
TEST(ParticipantCodec, RejectsControlCharactersAndSignalsThatAreNoNames) {
  auto message = codec_checks::message_of<ParticipantType>({});
  message.signals = "error:rad,nu:rad/s\n!touch PWNED\n#";
  EXPECT_EQ(verdict<ParticipantType>({}, codec_checks::lcm_bytes(message)), Rejection::bad_text);
  message.signals = "er\"ror:rad";
  EXPECT_EQ(verdict<ParticipantType>({}, codec_checks::lcm_bytes(message)), Rejection::bad_text);
  message.signals = "error:rad";
  message.law = "\x1b[2J";
  EXPECT_EQ(verdict<ParticipantType>({}, codec_checks::lcm_bytes(message)), Rejection::bad_text);
  message.law = "law";
  message.scenario = "two\nlines\tof text";
  EXPECT_EQ(verdict<ParticipantType>({}, codec_checks::lcm_bytes(message)), Rejection::bad_text);
  auto info = codec_checks::message_of<RunInfoType>({});
  EXPECT_EQ(verdict<RunInfoType>({}, codec_checks::lcm_bytes(info)), Rejection::none);
  info.scenario = "name: \x1b[2J\n";
  EXPECT_EQ(verdict<RunInfoType>({}, codec_checks::lcm_bytes(info)), Rejection::bad_text);
  Codec<messages::Participant> codec({});
  messages::Participant value;
  value.signals = "no unit";
  EXPECT_THROW(codec.encode({}, value), std::logic_error);
}
TEST(ParticipantCodec, CarriesTextsOfTheGreatestLengthAndRefusesLongerOnes) {
  Codec<messages::Participant> codec({});
  messages::Participant value;
  value.host = std::string(messages::max_participant_text, 'h');
  value.scenario = std::string(messages::max_participant_text, 's');
  value.measurement = std::string(messages::max_participant_text, 'm');
  value.fault = std::string(messages::max_participant_text, 'f');
  messages::Stamp stamp;
  messages::Participant got;
  ASSERT_EQ(codec.decode(codec.encode({}, value), stamp, got), Rejection::none);
  EXPECT_EQ(got.host, value.host);
  EXPECT_EQ(got.scenario, value.scenario);
  EXPECT_EQ(got.measurement, value.measurement);
  EXPECT_EQ(got.fault, value.fault);
  value.fault += 'x';
  EXPECT_THROW(codec.encode({}, value), std::length_error);

  auto message = codec_checks::message_of<ParticipantType>({});
  message.fault = value.fault;
  EXPECT_EQ(verdict<ParticipantType>({}, codec_checks::lcm_bytes(message)), Rejection::bad_text);
}
TEST(ParticipantCodec, RefusesToEncodeWhatItWouldNotDecode) {
  Codec<messages::Participant> codec({});
  messages::Participant value;
  EXPECT_NO_THROW(codec.encode({}, value));
  value.host = std::string("a\0b", 3);
  EXPECT_THROW(codec.encode({}, value), std::logic_error);
  value.host.clear();
  value.error_norm = -1;
  EXPECT_THROW(codec.encode({}, value), std::logic_error);
  value.error_norm = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(codec.encode({}, value), std::domain_error);
  value.error_norm = 0;
  value.fault_code = 256;
  EXPECT_THROW(codec.encode({}, value), std::logic_error);
}
TEST(ParticipantCodec, CarriesEveryExitCode) {
  Codec<messages::Participant> codec({});
  for (int code = 0; code < 256; ++code) {
    messages::Participant value;
    value.fault_code = code;
    messages::Stamp stamp;
    messages::Participant got;
    ASSERT_EQ(codec.decode(codec.encode({}, value), stamp, got), Rejection::none);
    EXPECT_EQ(got.fault_code, code);
  }
}

TEST(RunInfoCodec, RejectsNonFinitePeriod) {
  codec_checks::rejects_non_finite<RunInfoType>(body + 8, 1, {});
}
TEST(RunInfoCodec, FitsOneDatagramOrIsRefused) {
  Codec<messages::RunInfo> codec({});
  messages::RunInfo value;
  value.num_ticks = 1;
  value.period_s = 1e-3;
  value.robot_description = std::string(messages::max_run_info_size - body - 16 - 7 * 5, 'x');
  EXPECT_EQ(codec.encode({}, value).size(), static_cast<std::size_t>(messages::max_run_info_size));
  value.scenario.push_back('y');
  EXPECT_THROW(codec.encode({}, value), std::length_error);

  auto message = codec_checks::message_of<RunInfoType>({});
  message.robot_description = value.robot_description;
  EXPECT_EQ(verdict<RunInfoType>({}, codec_checks::lcm_bytes(message)), Rejection::wrong_size);
}

}  // namespace
}  // namespace tachless::messages
