#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <random>
#include <string>
#include <vector>

/// Small logs, and damages of them with a record of the undamaged events.
namespace tachless::logger {

/// Returns a folder in memory if there is one, for tests that write tens of thousands of files.
std::filesystem::path quick_place();

std::string read_file(const std::filesystem::path& path);
void write_file(const std::filesystem::path& path, const std::string& bytes);

/// Returns one event's bytes, written without the code under test.
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

/// Finds the events in a log's bytes; the bytes must be undamaged.
SampleLog index_of(std::string bytes);

/// Returns a log with events of 0 to 60 random bytes on five channels.
SampleLog sample_log(int num_events, std::uint64_t seed);

struct DamagedLog {
  std::string bytes;
  std::map<std::size_t, std::size_t> intact;  ///< offset in `bytes` -> event of the sample
  bool cut_between_events = false;            ///< the loss is then not visible
};

DamagedLog undamaged(const SampleLog& log);
void cut(DamagedLog& damaged, const SampleLog& log, std::size_t length);
/// Removes the events in [begin, end) of the damaged log, which were overwritten, from `intact`.
void forget_touched(DamagedLog& damaged, const SampleLog& log, std::size_t begin, std::size_t end);
DamagedLog with_garbage(const SampleLog& log, std::size_t before_event, const std::string& garbage);
std::string garbage(std::mt19937_64& random, int length, bool with_sync_words);
void set_data_length(std::string& bytes, std::size_t event_offset, std::uint32_t length);
void set_data_length(DamagedLog& damaged, std::size_t event_offset, std::uint32_t length);

/// Number of damaged logs of a test: the environment's TACHLESS_DAMAGED_LOGS, else 5,000, or 1,000
/// under a slow sanitizer.
struct DamagePlan {
  std::uint64_t logs = 5'000;
  bool thorough = false;  ///< requested by the user: every check covers all logs
};
/// @throw std::invalid_argument if the variable is not a number
DamagePlan damage_plan();

/// Returns a log with one to eight damages: flipped bits, overwritten parts, garbage, removed
/// parts, false lengths, or a removed end.
DamagedLog damaged_at_random(const SampleLog& log, std::uint64_t seed);

}  // namespace tachless::logger
