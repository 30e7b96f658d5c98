#include "logger/log_file.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstring>
#include <ctime>
#include <fstream>
#include <lcm/lcm-cpp.hpp>
#include <limits>
#include <random>
#include <set>

#include "base/failure.h"
#include "tests/support/damaged_log.h"
#include "tests/support/temporary_directory.h"

namespace tachless::logger {
namespace {

using testing::HasSubstr;

std::span<const std::byte> bytes_of(std::string_view text) {
  return {reinterpret_cast<const std::byte*>(text.data()), text.size()};
}

std::string text_of(std::span<const std::byte> bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

class LogFile : public testing::Test {
 protected:
  TemporaryDirectory directory_;
  std::filesystem::path path_ = directory_.path() / "log";

  /// Redirects all further writes to `path_` through open descriptors to a full disk.
  void fill_disk() {
    const int full = ::open("/dev/full", O_WRONLY | O_CLOEXEC);
    for (const auto& open : std::filesystem::directory_iterator("/proc/self/fd")) {
      std::error_code gone;  // the descriptor of this listing
      if (std::filesystem::read_symlink(open, gone) != path_) continue;
      ASSERT_GE(::dup2(full, std::stoi(open.path().filename())), 0);
    }
    ::close(full);
  }

  std::vector<LogEvent> read_all(LogReader& reader) {
    std::vector<LogEvent> events;
    while (const auto event = reader.next()) events.push_back(*event);
    return events;
  }

  template <class Call>
  std::string failure_of(Call call) {
    try {
      call();
    } catch (const base::Failure& failure) {
      EXPECT_EQ(failure.code(), base::ExitCode::bad_usage);
      return failure.what();
    }
    return "no failure";
  }
};

TEST_F(LogFile, SaysSoWhenItIsRemovedOrReplacedWhileItIsWritten) {
  struct Case {
    void (*act)(const std::filesystem::path&);
    const char* said;
  };
  const std::vector<Case> cases = {
      {[](const auto& path) { std::filesystem::remove(path); }, "was removed or moved away"},
      {[](const auto& path) {
         std::filesystem::rename(path, path.string() + ".old");
         std::ofstream(path) << "another";
       },
       "was replaced by another file"},
  };
  for (const Case& each : cases) {
    SCOPED_TRACE(each.said);
    std::filesystem::remove(path_);
    LogWriter writer(path_);
    writer.append(1, "A", bytes_of("one"));
    writer.flush();
    each.act(path_);
    writer.append(2, "A", bytes_of("two"));
    EXPECT_THAT(failure_of([&] { writer.close(); }), HasSubstr(each.said));
    EXPECT_THAT(failure_of([&] { writer.append(3, "A", bytes_of("three")); }),
                HasSubstr("leave it alone until the run has ended"));
  }
}

TEST_F(LogFile, IsByteForByteWhatLcmWrites) {
  const auto twin = directory_.path() / "twin";
  {
    LogWriter ours(path_);
    lcm::LogFile theirs(twin, "w");
    std::mt19937_64 random(1);
    for (int i = 0; i < 300; ++i) {
      std::string data(random() % 500, 'x');
      for (char& c : data) c = static_cast<char>(random());
      const std::string channel = i % 3 ? "ARM_POSITION" : "C";
      const auto utime = static_cast<std::int64_t>(random() >> 2);
      ours.append(utime, channel, bytes_of(data));
      lcm::LogEvent event;
      event.timestamp = utime;
      event.channel = channel;
      event.datalen = static_cast<std::int32_t>(data.size());
      event.data = data.data();
      ASSERT_EQ(theirs.writeEvent(&event), 0);
    }
    ours.close();
    EXPECT_EQ(ours.bytes(), std::filesystem::file_size(path_));
    EXPECT_EQ(ours.num_events(), 300);
  }
  EXPECT_EQ(read_file(path_), read_file(twin));
}

TEST_F(LogFile, IsReadByLcmAndReadsLcm) {
  const auto log = sample_log(50, 2);
  write_file(path_, log.bytes);
  lcm::LogFile theirs(path_, "r");
  LogReader ours(path_);
  int count = 0;
  while (const lcm::LogEvent* event = theirs.readNextEvent()) {
    const auto mine = ours.next();
    ASSERT_TRUE(mine);
    EXPECT_EQ(mine->number, event->eventnum);
    EXPECT_EQ(mine->utime, event->timestamp);
    EXPECT_EQ(mine->channel, event->channel);
    EXPECT_EQ(text_of(mine->data),
              std::string(static_cast<const char*>(event->data), event->datalen));
    ++count;
  }
  EXPECT_EQ(count, 50);
  EXPECT_FALSE(ours.next());
  EXPECT_FALSE(ours.damage().any());
}

TEST_F(LogFile, HoldsEventsOfAnySize) {
  // The sizes: longer than the writer's buffer, empty, and filling it to the last byte.
  const std::vector<std::size_t> sizes = {0, 1, 5'000'000, 3, (1 << 20) - 29, (1 << 20) - 28, 7};
  {
    LogWriter writer(path_);
    for (const auto size : sizes) writer.append(7, "C", bytes_of(std::string(size, 'a')));
    writer.close();
  }
  LogReader reader(path_);
  const auto events = read_all(reader);
  ASSERT_EQ(events.size(), sizes.size());
  for (std::size_t i = 0; i < sizes.size(); ++i) EXPECT_EQ(events[i].data.size(), sizes[i]);
  EXPECT_FALSE(reader.damage().any());
}

TEST_F(LogFile, EmptyFileHoldsNoEvents) {
  write_file(path_, "");
  LogReader reader(path_);
  EXPECT_FALSE(reader.next());
  EXPECT_FALSE(reader.damage().any());
}

TEST_F(LogFile, IsNotLeftBehindWithoutEvents) {
  { LogWriter writer(path_); }
  EXPECT_FALSE(std::filesystem::exists(path_));
  LogWriter again(path_);
  again.close();
  EXPECT_FALSE(std::filesystem::exists(path_));
}

TEST_F(LogFile, WriterRefusesAnExistingFile) {
  write_file(path_, "precious");
  EXPECT_THAT(failure_of([&] { LogWriter writer(path_); }),
              testing::AllOf(HasSubstr(path_.string()), HasSubstr("exists")));
  EXPECT_EQ(read_file(path_), "precious");
}

TEST_F(LogFile, WriterNamesAMissingDirectory) {
  const auto path = directory_.path() / "absent" / "log";
  EXPECT_THAT(failure_of([&] { LogWriter writer(path); }),
              testing::AllOf(HasSubstr(path.string()), HasSubstr("create the directory")));
}

TEST_F(LogFile, WriterNamesAnUnwritablePlace) {
  // /proc refuses new files even from root, who ignores permissions.
  EXPECT_THAT(failure_of([&] { LogWriter writer("/proc/log"); }), HasSubstr("/proc/log"));
}

TEST_F(LogFile, WriterSaysThatTheDiskIsFull) {
  LogWriter writer(path_);
  fill_disk();
  writer.append(0, "C", bytes_of("abc"));
  const auto first = failure_of([&] { writer.flush(); });
  EXPECT_THAT(first, testing::AllOf(HasSubstr(path_.string()), HasSubstr("No space left"),
                                    HasSubstr("first 0 bytes"), HasSubstr("free some space")));
  EXPECT_EQ(failure_of([&] { writer.append(0, "C", bytes_of("abc")); }), first)
      << "the first error stays";
  EXPECT_EQ(failure_of([&] { writer.close(); }), first);
}

TEST_F(LogFile, WriterKeepsEveryWholeEventUpToTheLimit) {
  struct rlimit old {};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &old), 0);
  const auto old_handler = std::signal(SIGXFSZ, SIG_IGN);
  const rlimit small{10'000, old.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &small), 0);
  std::string failure;
  {
    LogWriter writer(path_);
    for (int i = 0; i < 1000; ++i) writer.append(i, "CHANNEL", bytes_of(std::string(30, 'x')));
    failure = failure_of([&] { writer.close(); });
  }
  setrlimit(RLIMIT_FSIZE, &old);
  std::signal(SIGXFSZ, old_handler);
  constexpr int event = 28 + 7 + 30;
  constexpr int kept = 10'000 / event * event;
  EXPECT_THAT(failure, HasSubstr("first " + std::to_string(kept) + " bytes"));
  LogReader reader(path_);
  EXPECT_EQ(read_all(reader).size(), 10'000 / event);
  EXPECT_FALSE(reader.damage().any());
}

TEST_F(LogFile, WriterFlushesEveryFiftyMilliseconds) {
  LogWriter writer(path_);
  const auto start = std::chrono::steady_clock::now();
  writer.append(0, "C", bytes_of("abc"));
  writer.flush_if_due(start);
  EXPECT_EQ(std::filesystem::file_size(path_), 0u);
  writer.flush_if_due(start + std::chrono::milliseconds(51));
  EXPECT_EQ(std::filesystem::file_size(path_), writer.bytes());
  writer.append(0, "C", bytes_of("abc"));
  writer.flush_if_due(start + std::chrono::milliseconds(100));
  EXPECT_LT(std::filesystem::file_size(path_), writer.bytes());
}

TEST_F(LogFile, ReaderRefusesWhatIsNoRegularFile) {
  EXPECT_THAT(failure_of([&] { LogReader reader(path_); }), HasSubstr("No such file"));
  EXPECT_THAT(failure_of([&] { LogReader reader(directory_.path()); }), HasSubstr("regular"));
  EXPECT_THAT(failure_of([&] { LogReader reader("/dev/zero"); }), HasSubstr("regular"));
}

/// Reads the damaged log and checks that each untouched event is delivered unchanged.
/// @param lost counts the logs in which one is not, because garbage may imitate an event
void expect_intact_events_read(const std::filesystem::path& path, const SampleLog& log,
                               const DamagedLog& damaged, const std::string& what,
                               int* lost = nullptr) {
  write_file(path, damaged.bytes);
  LogReader reader(path);
  std::map<std::uint64_t, std::string> delivered;
  std::uint64_t last_end = 0;
  while (const auto event = reader.next()) {
    ASSERT_GE(event->offset, last_end) << what << ": events overlap";
    last_end = event->offset + event_header_bytes + event->channel.size() + event->data.size();
    delivered[event->offset] = damaged.bytes.substr(event->offset, last_end - event->offset);
  }
  for (const auto& [offset, index] : damaged.intact) {
    const auto& event = log.events[index];
    const auto found = delivered.find(offset);
    if (found == delivered.end() && lost != nullptr) {
      ++*lost;
      return;
    }
    ASSERT_TRUE(found != delivered.end()) << what << ": event " << index << " was lost";
    ASSERT_EQ(found->second, log.bytes.substr(event.offset, event.bytes)) << what;
  }
  std::uint64_t listed = 0;
  for (const auto& stretch : reader.damage().listed) listed += stretch.bytes;
  EXPECT_EQ(listed, reader.damage().bytes_skipped) << what;
  // Each byte is part of an event or counted as skipped.
  std::uint64_t read = 0;
  for (const auto& [offset, bytes] : delivered) read += bytes.size();
  EXPECT_EQ(read + reader.damage().bytes_skipped, damaged.bytes.size()) << what;
  // A damaged length that ends at the end of a truncated file cannot be detected.
  const bool ends_damaged = last_end == damaged.bytes.size() && !delivered.empty() &&
                            !damaged.intact.contains(delivered.rbegin()->first);
  if (delivered.size() < log.events.size() && !damaged.cut_between_events && !ends_damaged) {
    EXPECT_TRUE(reader.damage().any()) << what << ": lost in silence";
  }
}

TEST_F(LogFile, ReadsWhatIsWholeOfALogCutAtAnyByte) {
  const auto log = sample_log(8, 3);
  for (std::size_t length = 0; length < log.bytes.size(); ++length) {
    auto damaged = undamaged(log);
    cut(damaged, log, length);
    expect_intact_events_read(path_, log, damaged, "cut at " + std::to_string(length));
  }
}

TEST_F(LogFile, ReadsWhatIsWholeWhateverByteIsFlipped) {
  const auto log = sample_log(6, 4);
  for (std::size_t at = 0; at < log.bytes.size(); ++at) {
    for (const unsigned mask : {0x01u, 0x80u, 0xffu, 0x10u}) {
      auto damaged = undamaged(log);
      damaged.bytes[at] = static_cast<char>(damaged.bytes[at] ^ static_cast<char>(mask));
      forget_touched(damaged, log, at, at + 1);
      expect_intact_events_read(path_, log, damaged,
                                "flipped " + std::to_string(mask) + " at " + std::to_string(at));
    }
  }
}

TEST_F(LogFile, PassesOverGarbageBetweenEvents) {
  const auto log = sample_log(6, 5);
  std::mt19937_64 random(6);
  for (std::size_t gap = 0; gap <= log.events.size(); ++gap) {
    for (const int length : {1, 3, 4, 27, 28, 29, 100, 5000}) {
      for (const bool with_sync_words : {false, true}) {
        const auto damaged = with_garbage(log, gap, garbage(random, length, with_sync_words));
        expect_intact_events_read(path_, log, damaged, "garbage before " + std::to_string(gap));
      }
    }
  }
}

TEST_F(LogFile, HostileLengthsSwallowNothing) {
  const auto log = sample_log(12, 7);
  const auto rest = [&](std::size_t i) { return log.bytes.size() - log.events[i].offset; };
  for (std::size_t victim = 0; victim < log.events.size(); ++victim) {
    const std::size_t own = log.events[victim].bytes;
    std::vector<std::uint32_t> lengths = {0,          1,          0x7fffffff, 0x80000000,
                                          0xffffffff, 0x20000000, 0x00ffffff};
    // The lengths end anywhere in the rest of the log, on events' borders and at the end of the
    // file.
    for (std::size_t more = 0; more < rest(victim) + 2; more += 7) {
      lengths.push_back(static_cast<std::uint32_t>(more));
    }
    const std::size_t head = event_header_bytes + log.events[victim].channel.size();
    for (std::size_t later = victim; later < log.events.size(); ++later) {
      lengths.push_back(static_cast<std::uint32_t>(
          log.events[later].offset + log.events[later].bytes - log.events[victim].offset - head));
    }
    for (const auto length : lengths) {
      // A length like this is taken for the last event.
      if (head + length == rest(victim) && length != own - head) continue;
      auto damaged = undamaged(log);
      set_data_length(damaged, log.events[victim].offset, length);
      if (length != own - head) {
        forget_touched(damaged, log, log.events[victim].offset, log.events[victim].offset + 1);
      }
      expect_intact_events_read(
          path_, log, damaged,
          "length " + std::to_string(length) + " in " + std::to_string(victim));
    }
  }
}

TEST_F(LogFile, TenThousandDamagedLogsLoseOnlyWhatIsDamaged) {
  const auto log = sample_log(20, 8);
  int lost = 0;
  for (std::uint64_t seed = 0; seed < 10'000; ++seed) {
    expect_intact_events_read(path_, log, damaged_at_random(log, seed),
                              "seed " + std::to_string(seed), &lost);
    if (HasFatalFailure()) return;
  }
  // Garbage that imitates an event up to the following sync word makes an intact event unreadable.
  EXPECT_LE(lost, 5) << "seen: 1 of 10,000 logs; which one depends on the compiler";
}

TEST_F(LogFile, ALogWithinAMessageIsOneMessage) {
  const std::string inner = sample_log(5, 9).bytes;
  {
    LogWriter writer(path_);
    for (int i = 0; i < 3; ++i) writer.append(i, "FILE", bytes_of("prefix" + inner));
    writer.close();
  }
  LogReader reader(path_);
  EXPECT_EQ(read_all(reader).size(), 3u);
  EXPECT_FALSE(reader.damage().any());
}

TEST_F(LogFile, FollowsNoLink) {
  const auto other = directory_.path() / "other";
  write_file(other, "precious");
  std::filesystem::create_symlink(other, path_);
  EXPECT_THAT(failure_of([&] { LogWriter writer(path_); }), HasSubstr("move it away"));
  EXPECT_EQ(read_file(other), "precious");
}

TEST_F(LogFile, EveryNumberAnEventCanHaveIsRead) {
  constexpr auto most = std::numeric_limits<std::int64_t>::max();
  write_file(path_, event_text(most, 0, "C", "") + event_text(0, 0, "C", ""));
  LogReader reader(path_);
  EXPECT_EQ(read_all(reader).size(), 2u);
  EXPECT_EQ(reader.damage().missing_numbers, static_cast<std::uint64_t>(most));
  EXPECT_EQ(reader.damage().numbers_restarted, 1u);
}

TEST_F(LogFile, AHoleOfGigabytesTakesNoMemory) {
  const auto log = sample_log(2, 12);
  write_file(path_, log.bytes);
  std::filesystem::resize_file(path_, std::uintmax_t{1} << 30);
  LogReader reader(path_);
  EXPECT_EQ(read_all(reader).size(), 2u);
  rusage used{};
  getrusage(RUSAGE_SELF, &used);
  EXPECT_LT(used.ru_maxrss, 700'000) << "[kB]";
}

TEST_F(LogFile, CountsMissingAndRestartedNumbers) {
  const auto log = sample_log(10, 10);
  const auto& e = log.events;
  // Events 3 to 5 are cut out cleanly. The same log follows, as lcm-logger appends it.
  write_file(path_, log.bytes.substr(0, e[3].offset) + log.bytes.substr(e[6].offset) + log.bytes);
  LogReader reader(path_);
  EXPECT_EQ(read_all(reader).size(), 17u);
  EXPECT_EQ(reader.damage().missing_numbers, 3u);
  EXPECT_EQ(reader.damage().numbers_restarted, 1u);
  EXPECT_EQ(reader.damage().bytes_skipped, 0u);
}

TEST_F(LogFile, RewindReadsTheSameAgain) {
  const auto log = sample_log(10, 11);
  write_file(path_, "junk" + log.bytes);
  LogReader reader(path_);
  const auto first = read_all(reader).size();
  const auto skipped = reader.damage().bytes_skipped;
  reader.rewind();
  EXPECT_EQ(read_all(reader).size(), first);
  EXPECT_EQ(reader.damage().bytes_skipped, skipped);
}

/// Returns headers with falling numbers, each of which claims the rest of the file.
std::string claims_upon_claims(std::uint32_t size) {
  std::string hostile;
  for (std::uint32_t n = 0; hostile.size() + 29 < size; ++n) {
    hostile += event_text(1'000'000 - n, 0, "C", "");
    set_data_length(hostile, hostile.size() - 29,
                    size - static_cast<std::uint32_t>(hostile.size()) - n % 7);
  }
  hostile.resize(size, 'x');
  return hostile;
}

TEST_F(LogFile, StaysLinearOnALogMadeToBeSlow) {
  write_file(path_, claims_upon_claims(2'000'000));
  const std::clock_t begin = std::clock();  // this process's time, without other processes
  LogReader reader(path_);
  read_all(reader);
  // Measured: 0.002 s, some seconds under the thread sanitizer. A quadratic algorithm would read
  // some 7e10 bytes, which takes minutes in any build.
  EXPECT_LT((std::clock() - begin) / CLOCKS_PER_SEC, 30);
}

TEST(Damage, SaysWhatIsLostAlsoWhereEveryByteIsOfAMessage) {
  Damage damage;
  EXPECT_EQ(damage.text(), "none");
  damage.missing_numbers = 2;
  EXPECT_THAT(damage.text(), HasSubstr("2 message numbers missing"));
}

}  // namespace
}  // namespace tachless::logger
