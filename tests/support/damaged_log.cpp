#include "tests/support/damaged_log.h"
#include "tests/support/sanitizer.h"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <fstream>
#include <iterator>
#include <stdexcept>

namespace tachless::logger {
namespace {

void put(std::string& to, std::uint64_t value, int bytes) {
  for (int shift = 8 * (bytes - 1); shift >= 0; shift -= 8) {
    to += static_cast<char>(value >> shift & 0xff);
  }
}

std::uint32_t get(const std::string& from, std::size_t at) {
  std::uint32_t value = 0;
  for (int i = 0; i < 4; ++i) value = value << 8 | static_cast<unsigned char>(from.at(at + i));
  return value;
}

/// Replaces [begin, end) of the damaged log.
void replace(DamagedLog& damaged, const SampleLog& log, std::size_t begin, std::size_t end,
             const std::string& with) {
  forget_touched(damaged, log, begin, end);
  damaged.bytes.replace(begin, end - begin, with);
  std::map<std::size_t, std::size_t> moved;
  for (const auto& [offset, index] : damaged.intact) {
    if (offset < begin && offset + log.events[index].bytes > begin) continue;
    moved[offset < begin ? offset : offset - (end - begin) + with.size()] = index;
  }
  damaged.intact = moved;
}

}  // namespace

std::filesystem::path quick_place() {
  const std::filesystem::path in_memory = "/dev/shm";
  const bool usable = access(in_memory.c_str(), W_OK | X_OK) == 0;
  return usable ? in_memory : std::filesystem::temp_directory_path();
}

std::string read_file(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

void write_file(const std::filesystem::path& path, const std::string& bytes) {
  std::ofstream file(path, std::ios::binary | std::ios::trunc);
  file << bytes;
  if (!file.flush()) throw std::runtime_error("cannot write " + path.string());
}

std::string event_text(std::int64_t number, std::int64_t utime, const std::string& channel,
                       const std::string& data) {
  std::string event;
  put(event, 0xEDA1DA01, 4);
  put(event, static_cast<std::uint64_t>(number), 8);
  put(event, static_cast<std::uint64_t>(utime), 8);
  put(event, channel.size(), 4);
  put(event, data.size(), 4);
  return event + channel + data;
}

SampleLog index_of(std::string bytes) {
  SampleLog log;
  for (std::size_t at = 0; at < bytes.size();) {
    const std::size_t channel = get(bytes, at + 20);
    const std::size_t size = 28 + channel + get(bytes, at + 24);
    log.events.push_back({at, size, bytes.substr(at + 28, channel)});
    at += size;
  }
  log.bytes = std::move(bytes);
  return log;
}

SampleLog sample_log(int num_events, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  const std::array<std::string, 5> channels = {"ARM_TICK", "ARM_POSITION", "ARM_REFERENCE", "X",
                                               "Y"};
  std::string bytes;
  for (int i = 0; i < num_events; ++i) {
    std::string data(random() % 61, '\0');
    for (char& c : data) c = static_cast<char>(random());
    bytes += event_text(i, i * 50, channels[random() % channels.size()], data);
  }
  return index_of(bytes);
}

DamagedLog undamaged(const SampleLog& log) {
  DamagedLog damaged{log.bytes, {}, false};
  for (std::size_t i = 0; i < log.events.size(); ++i) damaged.intact[log.events[i].offset] = i;
  return damaged;
}

void forget_touched(DamagedLog& damaged, const SampleLog& log, std::size_t begin, std::size_t end) {
  std::erase_if(damaged.intact, [&](const auto& entry) {
    const auto& [offset, index] = entry;
    return offset < end && begin < offset + log.events[index].bytes;
  });
}

void cut(DamagedLog& damaged, const SampleLog& log, std::size_t length) {
  forget_touched(damaged, log, length, damaged.bytes.size() + 1);
  damaged.bytes.resize(length);
  damaged.cut_between_events = length == 0;
  for (const auto& [offset, index] : damaged.intact) {
    if (offset + log.events[index].bytes == length) damaged.cut_between_events = true;
  }
}

DamagedLog with_garbage(const SampleLog& log, std::size_t before_event,
                        const std::string& garbage) {
  auto damaged = undamaged(log);
  const std::size_t at =
      before_event < log.events.size() ? log.events[before_event].offset : log.bytes.size();
  replace(damaged, log, at, at, garbage);
  return damaged;
}

std::string garbage(std::mt19937_64& random, int length, bool with_sync_words) {
  std::string bytes(static_cast<std::size_t>(length), '\0');
  for (char& c : bytes) c = static_cast<char>(random());
  if (with_sync_words) {
    const std::string sync = "\xED\xA1\xDA\x01";
    for (std::size_t at = 0; at + 4 <= bytes.size(); at += 4 + random() % 40) {
      bytes.replace(at, 4, sync);
      // Some of them have lengths and a channel that pass the checks, and claim the bytes that
      // follow.
      if (random() % 3 == 0 && at + 29 <= bytes.size()) {
        std::string header = event_text(static_cast<std::int64_t>(random() % 50), 0, "Z", "");
        set_data_length(header, 0, static_cast<std::uint32_t>(random() % 3000));
        bytes.replace(at, header.size(), header);
      }
    }
  }
  return bytes;
}

void set_data_length(std::string& bytes, std::size_t event_offset, std::uint32_t length) {
  std::string text;
  put(text, length, 4);
  bytes.replace(event_offset + 24, 4, text);
}

void set_data_length(DamagedLog& damaged, std::size_t event_offset, std::uint32_t length) {
  set_data_length(damaged.bytes, event_offset, length);
}

DamagePlan damage_plan() {
  DamagePlan plan;
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  plan.logs = 1'000;
#endif
  if (const char* variable = std::getenv("TACHLESS_DAMAGED_LOGS")) {
    plan.logs = std::stoull(variable);
    plan.thorough = true;
  }
  return plan;
}

DamagedLog damaged_at_random(const SampleLog& log, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  auto damaged = undamaged(log);
  const int num_damages = 1 + static_cast<int>(random() % 8);
  for (int i = 0; i < num_damages; ++i) {
    const std::size_t size = damaged.bytes.size();
    if (size < 64) break;
    const std::size_t at = random() % size;
    switch (random() % 6) {
      case 0:
        forget_touched(damaged, log, at, at + 1);
        damaged.bytes[at] =
            static_cast<char>(damaged.bytes[at] ^ static_cast<char>(1u << random() % 8));
        break;
      case 1: {
        const std::size_t end = std::min(size, at + 1 + random() % 40);
        replace(damaged, log, at, end,
                garbage(random, static_cast<int>(end - at), random() % 2 == 0));
        break;
      }
      case 2:
        replace(damaged, log, at, at,
                garbage(random, 1 + static_cast<int>(random() % 60), random() % 2 == 0));
        break;
      case 3:
        replace(damaged, log, at, std::min(size, at + 1 + random() % 80), "");
        break;
      case 4:
        if (!damaged.intact.empty()) {
          auto victim = damaged.intact.begin();
          std::advance(victim, random() % damaged.intact.size());
          const std::size_t offset = victim->first;
          set_data_length(damaged, offset,
                          static_cast<std::uint32_t>(random() >> (random() % 33 + 31)));
          forget_touched(damaged, log, offset, offset + 1);
        }
        break;
      default:
        cut(damaged, log, size - random() % 40);
    }
  }
  // A cut may end between events. The event numbers then show the gap, unless it was at the end.
  damaged.cut_between_events = true;
  if (!damaged.intact.empty()) {
    const auto& [offset, index] = *damaged.intact.rbegin();
    damaged.cut_between_events =
        offset + log.events[index].bytes == damaged.bytes.size() || damaged.bytes.empty();
  }
  return damaged;
}

}  // namespace tachless::logger
