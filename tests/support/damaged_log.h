#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <random>
#include <string>
#include <vector>

/// Small logs, and ways to damage them that know which events they left alone.
namespace tachless::logger {

/// In memory where there is such a place, for tests that write tens of thousands of files.
std::filesystem::path quick_place();

std::string read_file(const std::filesystem::path& path);
void write_file(const std::filesystem::path& path, const std::string& bytes);

/// One event's bytes, written without the code under test.
std::string event_text(std::int64_t number, std::int64_t utime, const std::string& channel,
                       const std::string& data);

struct SampleLog {
  struct Event {
    std::size_t offset = 0, bytes = 0;
    std::string channel;
  };
  std::string bytes;
  std::vector<Event> events;
};

/// Where the events of a log's bytes are; the bytes must be undamaged.
SampleLog index_of(std::string bytes);

/// Events of 0 to 60 random bytes on five channels.
SampleLog sample_log(int num_events, std::uint64_t seed);

struct DamagedLog {
  std::string bytes;
  std::map<std::size_t, std::size_t> intact;  ///< offset in `bytes` -> event of the sample
  bool cut_between_events = false;            ///< then the loss cannot be seen
};

DamagedLog undamaged(const SampleLog& log);
void cut(DamagedLog& damaged, const SampleLog& log, std::size_t length);
/// Bytes [begin, end) of the damaged log were written to.
void forget_touched(DamagedLog& damaged, const SampleLog& log, std::size_t begin, std::size_t end);
DamagedLog with_garbage(const SampleLog& log, std::size_t before_event, const std::string& garbage);
std::string garbage(std::mt19937_64& random, int length, bool with_sync_words);
void set_data_length(std::string& bytes, std::size_t event_offset, std::uint32_t length);
void set_data_length(DamagedLog& damaged, std::size_t event_offset, std::uint32_t length);

/// On how many damaged logs a test tries its luck: the environment's TACHLESS_DAMAGED_LOGS, else
/// 10,000, or 1,000 where a sanitizer makes each of them dear.
struct DamagePlan {
  std::uint64_t logs = 10'000;
  bool thorough = false;  ///< asked for: nothing is done on a part of the logs only
};
/// @throw std::invalid_argument when the variable is not a number
DamagePlan damage_plan();

/// One to eight damages: flips, overwritten stretches, garbage, stretches cut out, hostile lengths,
/// the end cut off.
DamagedLog damaged_at_random(const SampleLog& log, std::uint64_t seed);

}  // namespace tachless::logger
