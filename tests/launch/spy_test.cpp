// lcm-spy beside a run, in a network and on a display of their own. What it shows is read off its
// window; the pictures stay in build/…/screenshots.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cctype>
#include <chrono>
#include <csignal>
#include <cstddef>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "bus/udp_transport.h"
#include "bus/wire.h"
#include "tests/launch/endless_run.h"
#include "tests/support/private_network.h"
#include "tests/support/program.h"
#include "tests/support/virtual_display.h"

using namespace tachless;

namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

namespace fs = std::filesystem;

fs::path screenshot(const std::string& name) {
  const fs::path folder = TACHLESS_BINARY_DIR "/screenshots";
  fs::create_directories(folder);
  return folder / name;
}

/// Sends what one run does not: the other measurements, and a message of no type. Until destroyed.
class Strangers {
 public:
  Strangers() : thread_([this] { send(); }) {}
  ~Strangers() {
    done_ = true;
    thread_.join();
  }
  Strangers(const Strangers&) = delete;
  Strangers& operator=(const Strangers&) = delete;

 private:
  void send() {
    const robot::Vector x = robot::Vector::Constant(3, 0.5);
    const loop::Layout layout{3, 3, 0};
    bus::Codec<loop::PositionMeasurement> position(layout);
    bus::Codec<loop::MotorPositionMeasurement> motor_position(layout);
    bus::Codec<loop::StateMeasurement> state(layout);
    bus::UdpTransport transport;
    for (std::int64_t k = 0; !done_; ++k) {
      transport.publish("OTHER_POSITION", position.encode({k, 1, k}, {x}));
      transport.publish("OTHER_MOTOR_POSITION", motor_position.encode({k, 1, k}, {x}));
      transport.publish("OTHER_STATE", state.encode({k, 1, k}, {x, x, x, x}));
      transport.publish("ZZZ", std::as_bytes(std::span("a message of no type")));
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
  }

  std::atomic<bool> done_{false};
  std::thread thread_;
};

/// The table of lcm-spy's window: white cells between grey lines.
class Table {
 public:
  explicit Table(const fs::path& path) : picture_(path) {
    const int margin = picture_.width - 12;  // at the right end of the last column: no text there
    for (int y = 0; y < picture_.height; ++y) {
      const int top = y;
      while (y < picture_.height && picture_.at(margin, y) == 255) ++y;
      if (y - top >= 10) rows_.push_back({top, y - top});
    }
    if (rows_.empty()) return;
    for (int x = 0; x < picture_.width; ++x) {
      const int left = x;
      // The uppermost line of a cell is above its text.
      while (x < picture_.width && picture_.at(x, rows_[0].begin) == 255) ++x;
      if (x - left >= 10) columns_.push_back({left, x - left});
    }
  }

  [[nodiscard]] std::size_t rows() const { return rows_.size(); }
  [[nodiscard]] std::size_t columns() const { return columns_.size(); }
  [[nodiscard]] Picture cell(std::size_t row, std::size_t column) const {
    return picture_.part(columns_.at(column).begin, rows_.at(row).begin, columns_[column].size,
                         rows_[row].size);
  }
  /// All rows at once: their lines are left out.
  [[nodiscard]] Picture column(std::size_t column) const {
    Picture result = cell(0, column);
    for (std::size_t row = 1; row < rows_.size(); ++row) {
      const Picture more = cell(row, column);
      result.pixels.insert(result.pixels.end(), more.pixels.begin(), more.pixels.end());
      result.height += more.height;
    }
    return result;
  }
  [[nodiscard]] int middle_of(std::size_t row) const {
    return rows_.at(row).begin + rows_[row].size / 2;
  }

 private:
  struct Extent {
    int begin, size;
  };
  Picture picture_;
  std::vector<Extent> rows_, columns_;
};

/// What lcm-spy should list, in its order; the network check of `tachless run` comes after, with a
/// number in its name.
struct Row {
  std::string channel, type;
};
const std::vector<Row> expected = {{"ARM_COMMAND", "torque_command_t"},
                                   {"ARM_CONTROLLER_STATE", "controller_state_t"},
                                   {"ARM_LINK_STATE", "link_state_measure"},  // the rest is cut off
                                   {"ARM_LOG_ACK", "log_ack_t"},
                                   {"ARM_PARTICIPANT", "participant_t"},
                                   {"ARM_REFERENCE", "reference_t"},
                                   {"ARM_RUN_INFO", "run_info_t"},
                                   {"ARM_TICK", "tick_t"},
                                   {"ARM_TRUTH", "plant_truth_t"},
                                   {"OTHER_MOTOR_POSITION", "motor_position_meas"},
                                   {"OTHER_POSITION", "position_measure"},
                                   {"OTHER_STATE", "state_measurement_t"}};
constexpr std::size_t truth_row = 8;
constexpr std::size_t network_check_row = 12;
constexpr std::size_t stranger_row = 13;
constexpr std::size_t channel_column = 0;
constexpr std::size_t type_column = 1;
constexpr std::size_t messages_column = 2;
constexpr std::size_t undecodable_column = 7;

std::string letters(const std::string& text) {
  std::string result;
  std::copy_if(text.begin(), text.end(), std::back_inserter(result),
               [](unsigned char c) { return std::isalnum(c) != 0; });
  return result;
}

TEST(Spy, DecodesEveryChannelAndShowsTheFieldsOfOne) {
  const TemporaryDirectory directory;
  const VirtualDisplay display(directory);
  Program spy("tachless", {"spy"}, directory.path());
  std::optional<std::string> window;
  wait_until("the window of lcm-spy", [&] {
    if (!spy.running()) throw std::runtime_error(spy.errors() + spy.output());
    return (window = display.window("LCM Spy")).has_value();
  });
  const std::string picture = directory / "spy.pgm";
  std::optional<Table> table;
  const auto look = [&] {
    display.picture(*window, picture);
    table.emplace(picture);
    return table->rows();
  };
  const Strangers strangers;
  wait_until("lcm-spy to hear the test", [&] { return look() == 4; });
  EndlessRun run(directory);
  wait_until("every channel in lcm-spy", [&] {
    if (!run.program().running()) throw std::runtime_error(run.program().errors());
    return look() == expected.size() + 2;
  });
  wait_until("the run to get going", [&] { return run.under_way(); });
  const auto figures = table->cell(0, messages_column).pixels;
  wait_until("lcm-spy to count on", [&] {
    look();
    return table->cell(0, messages_column).pixels != figures;
  });
  display.picture(*window, screenshot("spy_channels.png"));

  // By its own words.
  EXPECT_THAT(spy.output(), AllOf(HasSubstr("Found 12 LCM types"),
                                  Not(HasSubstr("messageReceived ex")), Not(HasSubstr("WARNING"))));
  // By what is on the screen: names and types as a reader of texts reads them, …
  ASSERT_EQ(table->columns(), 8U);
  const fs::path part = directory / "part.pgm";
  table->column(channel_column).save(part);
  const std::string channels = letters_in(part, directory);
  table->column(type_column).save(part);
  const std::string types = letters_in(part, directory);
  for (const Row& row : expected) {
    EXPECT_THAT(channels, HasSubstr(letters(row.channel)));
    EXPECT_THAT(types, HasSubstr(letters(row.type)));
  }
  // … and in the last column the same figure, a zero, for every one of our types, and another one
  // for the message of no type.
  const Picture zero = table->cell(0, undecodable_column);
  zero.save(part);
  EXPECT_THAT(letters_in(part, directory), ::testing::AnyOf("0", "O", "o"));
  for (std::size_t row = 0; row < expected.size(); ++row) {
    EXPECT_EQ(table->cell(row, undecodable_column).pixels, zero.pixels) << expected[row].channel;
  }
  EXPECT_NE(table->cell(stranger_row, undecodable_column).pixels, zero.pixels);
  EXPECT_NE(table->cell(network_check_row, undecodable_column).pixels, zero.pixels);
  EXPECT_NE(table->cell(0, messages_column).pixels, table->cell(4, messages_column).pixels);

  // A double click opens the fields of a message.
  std::optional<std::string> fields;
  wait_until("the fields of ARM_TRUTH", [&] {
    display.double_click(*window, 60, table->middle_of(truth_row));
    for (int i = 0; i < 20 && !fields; ++i) {
      fields = display.window("ARM_TRUTH");
      if (!fields) std::this_thread::sleep_for(std::chrono::milliseconds(100));
    }
    return fields.has_value();
  });
  std::string text;
  wait_until("the fields to be drawn", [&] {
    display.picture(*fields, screenshot("spy_fields.png"));
    text = letters_in(screenshot("spy_fields.png"), directory);
    return text.find("utime") != std::string::npos;
  });
  EXPECT_THAT(text, AllOf(HasSubstr("planttrutht"), HasSubstr("numjoints2"), HasSubstr("position0"),
                          HasSubstr("velocity1")));
  EXPECT_EQ(run.interrupt(), 130);
  const auto summary = nlohmann::json::parse(contents(directory / "out/summary.json"));
  EXPECT_EQ(summary["log"]["gaps"], 0);
  spy.signal(SIGTERM);
  spy.wait();
}

class SpyWithoutDisplay : public ::testing::TestWithParam<const char*> {};

TEST_P(SpyWithoutDisplay, SaysSoAndEnds) {
  const TemporaryDirectory directory;
  setenv("DISPLAY", GetParam(), 1);
  Program spy("tachless", {"spy"}, directory.path());
  EXPECT_EQ(spy.wait(), 2);
  EXPECT_THAT(spy.errors(), AllOf(HasSubstr("spy: no display: "), HasSubstr("tachless watch")));
  const std::string errors = spy.errors();
  EXPECT_EQ(std::count(errors.begin(), errors.end(), '\n'), 1);
}

INSTANTIATE_TEST_SUITE_P(Displays, SpyWithoutDisplay,
                         ::testing::Values("", ":5000", "nonsense", ":x", "127.0.0.1:999",
                                           "host:"));

TEST(Spy, SaysWhichPackageIsMissing) {
  const TemporaryDirectory directory;
  const VirtualDisplay display(directory);
  const std::string path = getenv("PATH");
  fs::create_directories(directory / "jre/bin");
  setenv("PATH", (directory / "jre/bin").c_str(), 1);
  Program none("tachless", {"spy"}, directory.path());
  EXPECT_EQ(none.wait(), 2);
  EXPECT_THAT(none.errors(),
              HasSubstr("there is no java; as root, type: apt-get install default-jre"));
  // A runtime that was installed without its windows.
  fs::copy_file("/bin/true", directory / "jre/bin/java");
  Program headless("tachless", {"spy"}, directory.path());
  EXPECT_EQ(headless.wait(), 2);
  EXPECT_THAT(headless.errors(), AllOf(HasSubstr("without windows"), HasSubstr("default-jre")));
  setenv("PATH", path.c_str(), 1);
}

}  // namespace
