// Reads MCAP files with a reader that shares nothing with the writer. It reads record by record as
// specified, then every message again through the summary and the indexes.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "base/json_text.h"
#include "logger/export.h"
#include "logger/mcap.h"
#include "tests/support/damaged_log.h"
#include "tests/support/recorded_run.h"
#include "tests/support/temporary_directory.h"

namespace tachless::logger {
namespace {

using nlohmann::json;

/// A cursor over bytes.
struct Bytes {
  std::string_view left;

  template <class Number>
  Number number() {
    Number value;
    EXPECT_GE(left.size(), sizeof(value));
    std::memcpy(&value, left.data(), sizeof(value));
    left.remove_prefix(sizeof(value));
    return value;
  }
  std::string_view take(std::size_t size) {
    EXPECT_LE(size, left.size());
    const auto taken = left.substr(0, size);
    left.remove_prefix(taken.size());
    return taken;
  }
  std::string text() { return std::string(take(number<std::uint32_t>())); }
  /// Returns the next record's content; `op` receives its kind.
  Bytes record(int& op) {
    op = number<std::uint8_t>();
    return {take(number<std::uint64_t>())};
  }
};

struct Message {
  std::string topic;
  std::uint32_t sequence;
  std::uint64_t time_ns;
  std::string data;
  bool operator==(const Message&) const = default;
};

struct McapFile {
  /// By channel: its name; its schema's name.
  std::map<std::uint16_t, std::string> topics, schemas;
  std::vector<Message> in_order, by_index;
  std::uint64_t counted = 0;  ///< message count in the statistics

  explicit McapFile(const std::string& file) {
    const std::string_view magic("\x89MCAP0\r\n", 8);
    EXPECT_TRUE(file.starts_with(magic) && file.ends_with(magic));
    Bytes all{std::string_view(file).substr(8, file.size() - 16)};
    int op = 0, last = 0;
    while (!all.left.empty()) {
      Bytes record = all.record(op);
      last = op;
      if (op == 0x06) chunk(record);
      if (op == 0x08) chunk_index(record, file);
      if (op == 0x0B) counted = record.number<std::uint64_t>();
    }
    EXPECT_EQ(last, 0x02) << "the footer is last";
  }

  void chunk(Bytes record) {
    const auto begin = record.number<std::uint64_t>(), end = record.number<std::uint64_t>();
    const auto size = record.number<std::uint64_t>();
    EXPECT_EQ(record.number<std::uint32_t>(), 0U);
    EXPECT_EQ(record.text(), "");
    EXPECT_EQ(record.number<std::uint64_t>(), size);
    EXPECT_EQ(record.left.size(), size);
    for (int op = 0; !record.left.empty();) {
      Bytes inner = record.record(op);
      if (op == 0x03) schema(inner);
      if (op == 0x04) channel(inner);
      if (op != 0x05) continue;
      in_order.push_back(message(inner));
      EXPECT_GE(in_order.back().time_ns, begin);
      EXPECT_LE(in_order.back().time_ns, end);
    }
  }
  void schema(Bytes record) {
    const auto id = record.number<std::uint16_t>();
    schemas[id] = record.text();
    EXPECT_EQ(record.text(), "jsonschema");
    EXPECT_EQ(base::parse_json(record.text())["type"], "object");
  }
  void channel(Bytes record) {
    const auto id = record.number<std::uint16_t>();
    EXPECT_TRUE(schemas.contains(record.number<std::uint16_t>()));
    topics[id] = record.text();
    EXPECT_EQ(record.text(), "json");
  }
  [[nodiscard]] Message message(Bytes record) const {
    const auto channel = record.number<std::uint16_t>();
    const auto sequence = record.number<std::uint32_t>();
    const auto time_ns = record.number<std::uint64_t>();
    EXPECT_EQ(record.number<std::uint64_t>(), time_ns);
    return {topics.at(channel), sequence, time_ns, std::string(record.left)};
  }
  void chunk_index(Bytes record, const std::string& file) {
    record.take(16);
    const auto offset = record.number<std::uint64_t>(), length = record.number<std::uint64_t>();
    int op = 0;
    Bytes chunk = Bytes{std::string_view(file).substr(offset, length)}.record(op);
    EXPECT_EQ(op, 0x06);
    chunk.take(28);
    (void)chunk.text();
    chunk.take(8);
    Bytes offsets{record.take(record.number<std::uint32_t>())};
    while (!offsets.left.empty()) {
      const auto channel = offsets.number<std::uint16_t>();
      Bytes index =
          Bytes{std::string_view(file).substr(offsets.number<std::uint64_t>())}.record(op);
      EXPECT_EQ(op, 0x07);
      EXPECT_EQ(index.number<std::uint16_t>(), channel);
      Bytes entries{index.take(index.number<std::uint32_t>())};
      while (!entries.left.empty()) {
        const auto time_ns = entries.number<std::uint64_t>();
        Bytes at{chunk.left.substr(entries.number<std::uint64_t>())};
        by_index.push_back(message(at.record(op)));
        EXPECT_EQ(op, 0x05);
        EXPECT_EQ(by_index.back().time_ns, time_ns);
        EXPECT_EQ(by_index.back().topic, topics.at(channel));
      }
    }
  }
};

class Mcap : public ::testing::Test {
 protected:
  TemporaryDirectory directory_;
  std::filesystem::path file_ = directory_.path() / "run.mcap";
};

TEST_F(Mcap, HoldsEveryMessageOfARunWithItsNumbersInFull) {
  const auto path = directory_.path() / "lcmlog";
  write_file(path, recorded_run("paper_rigid.yaml", {"loop.duration_s=0.02"}, "POSITION").bytes());
  auto log = RunLog::open(path);
  export_run(log, file_);
  const McapFile file(read_file(file_));
  EXPECT_EQ(file.in_order.size(), file.counted);
  EXPECT_THAT(file.by_index, ::testing::UnorderedElementsAreArray(file.in_order));
  std::map<std::string, std::vector<json>> messages;
  for (const Message& each : file.in_order) {
    messages[each.topic].push_back(base::parse_json(each.data));
    EXPECT_EQ(each.sequence + 1, messages[each.topic].size());
  }
  EXPECT_EQ(file.schemas.at(7), "foxglove.JointStates");
  log.rewind();
  std::size_t k = 0;
  for (TickRecord record; log.next(record); ++k) {
    const json& reference = messages["ARM_REFERENCE"].at(k);
    EXPECT_EQ(reference["tick"], record.tick);
    EXPECT_EQ(reference["snap_ref"][1], record.reference->snap_ref[1]);
    EXPECT_EQ(messages["ARM_CONTROLLER_STATE"].at(k)["nu"][0],
              record.controller_state->value[1][0]);
    const json& states = messages["ARM_JOINT_STATES"].at(k);
    EXPECT_EQ(states["joints"][1]["position"], record.truth->q[1]);
    EXPECT_EQ(states["joints"][1]["effort"], record.truth->tau[1]);
    EXPECT_NEAR(states["timestamp"]["nsec"].get<double>(),
                1e9 * static_cast<double>(record.tick) * log.info().period_s, 0.5);
  }
  EXPECT_EQ(messages["ARM_JOINT_STATES_REFERENCE"].size(), k);
  EXPECT_EQ(messages["ARM_TICK"].size(), k);
}

TEST_F(Mcap, DescribesASignalWhateverItsUnitIs) {
  const auto path = directory_.path() / "lcmlog";
  write_file(path, recorded_run("paper_rigid.yaml", {"loop.duration_s=0.002"}, "POSITION",
                                "error:rad,x:\"m\\")
                       .bytes());
  auto log = RunLog::open(path);
  export_run(log, file_);
  EXPECT_EQ(McapFile(read_file(file_)).schemas.at(5), "tachless.ARM_CONTROLLER_STATE")
      << "and all schemas are JSON";
}

TEST_F(Mcap, FindsMessagesInSeveralChunks) {
  McapWriter writer(file_);
  const auto channel = writer.add_channel("a", "b", R"({"type":"object"})");
  const std::string text = "{\"x\":\"" + std::string(300'000, 'x') + "\"}";
  for (std::uint64_t k = 0; k < 10; ++k) writer.add(channel, 7 * k, text);
  writer.close();
  const McapFile file(read_file(file_));
  EXPECT_EQ(file.counted, 10U);
  EXPECT_EQ(file.by_index, file.in_order);
}

TEST_F(Mcap, LeavesNothingOnAFullDisk) {
  McapWriter writer("/dev/full");
  EXPECT_THROW(
      {
        for (int k = 0; k < 20; ++k) writer.add(1, 0, std::string(100'000, ' '));
        writer.close();
      },
      std::system_error);
}

}  // namespace
}  // namespace tachless::logger
