#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

/// LCM's event-log format, as liblcm's own LogFile writes and reads it: events back to back,
/// big-endian. An event has a sync word 0xEDA1DA01, event number (int64), time stamp [us] (int64),
/// channel length (int32), data length (int32), channel and data.
namespace tachless::logger {

inline constexpr std::size_t event_header_bytes = 28;

/// Longest channel name the LCM protocol allows [bytes].
inline constexpr std::size_t max_channel_bytes = 63;

/// Appends events to a log. Nothing is allocated between construction and `sync`. The first error
/// of the file system ends the log and cuts the file after its last whole event. This and every
/// further call then throws a Failure that names path, bytes kept and remedy.
class LogWriter {
 public:
  /// Time between two flushes. A busy machine may delay a flush, so a killed logger loses at most
  /// twice this time.
  static constexpr std::chrono::milliseconds flush_interval{50};

  /// Creates the file. Does not follow a symbolic link.
  /// @throw base::Failure(bad_usage) when the file exists, or the directory is missing or not
  /// writable.
  explicit LogWriter(std::filesystem::path path);
  LogWriter(const LogWriter&) = delete;
  LogWriter& operator=(const LogWriter&) = delete;
  /// Closes the log and drops errors; `close` throws them.
  ~LogWriter();

  /// Appends an event.
  /// @param utime time stamp [us]
  /// @throw base::Failure when the file cannot be written
  /// @throw std::logic_error after `close`, and when the channel is empty or longer than
  /// `max_channel_bytes`
  void append(std::int64_t utime, std::string_view channel, std::span<const std::byte> data);

  /// Hands all events to the operating system. The events are then kept if this process is killed.
  void flush();

  /// Flushes when `flush_interval` has passed since the last flush. Otherwise the call is cheap.
  void flush_if_due(std::chrono::steady_clock::time_point now);

  /// Function that returns once `done` returns true.
  using Wait = std::function<void(const std::function<bool()>& done)>;
  /// Flushes, and waits until the disk has all events. A busy disk takes seconds, during which
  /// `meanwhile` runs.
  void sync(const Wait& meanwhile = {});

  /// Syncs and closes the log. Removes a log without events.
  /// @throw base::Failure(bad_usage) also when the file was removed or replaced meanwhile
  void close();

  [[nodiscard]] std::int64_t num_events() const { return num_events_; }
  /// Returns the length of the log, including events that are not flushed yet [bytes].
  [[nodiscard]] std::uint64_t bytes() const { return written_ + filled_; }

 private:
  void write_out(std::span<const std::byte> data);
  [[noreturn]] void fail(int error);
  void require_usable() const;
  void require_own_file();

  std::filesystem::path path_;
  int file_ = -1;
  std::vector<std::byte> buffer_;  // whole events only
  std::size_t filled_ = 0;
  std::uint64_t written_ = 0;
  std::uint64_t whole_ = 0;  // end of the last whole event known to be in the file
  std::int64_t num_events_ = 0;
  std::chrono::steady_clock::time_point last_flush_;
  std::string failure_;  // message of the first error
};

/// Appends an event to a closed log. Its number follows the last event's. Its time stamp is the
/// last event's.
/// @throw base::Failure(bad_usage) when the log cannot be read or written
void append_event(const std::filesystem::path& path, std::string_view channel,
                  std::span<const std::byte> data);

/// One event of a log. Views stay valid as long as the reader.
struct LogEvent {
  std::int64_t number = 0;
  std::int64_t utime = 0;  ///< [us]
  std::string_view channel;
  std::span<const std::byte> data;
  std::uint64_t offset = 0;  ///< offset of the first byte in the file

  /// Returns the offset of the byte after the event.
  [[nodiscard]] std::uint64_t end() const {
    return offset + event_header_bytes + channel.size() + data.size();
  }
};

/// A stretch of a log that holds no event.
struct DamagedStretch {
  std::uint64_t offset = 0;
  std::uint64_t bytes = 0;
};

/// Losses of a log in the part that was read.
struct Damage {
  static constexpr std::size_t max_listed = 1000;

  std::uint64_t stretches = 0;
  std::uint64_t bytes_skipped = 0;
  std::vector<DamagedStretch> listed;   ///< the first `max_listed` of them
  std::uint64_t missing_numbers = 0;    ///< event numbers passed over
  std::uint64_t numbers_restarted = 0;  ///< event number went back (lcm-logger appending does that)

  [[nodiscard]] bool any() const { return stretches != 0 || missing_numbers != 0; }
  /// Returns e.g. "none", or "7 bytes in 1 places hold no message; 0 message numbers missing".
  [[nodiscard]] std::string text() const;
};

/// Reader of any LCM log from front to back, damaged or not. It skips and counts bytes that are not
/// an event. It resumes at the next sync word with possible lengths and a possible channel name. It
/// rejects an event that holds the beginning of another and has no successor behind it. The format
/// has no checksum. The reader does not notice damage inside a channel name, a time stamp or data.
///
/// The reader maps the file, so that its memory stays bounded. No other process may shorten the
/// file meanwhile. The reader does not follow growth.
class LogReader {
 public:
  /// @throw base::Failure(bad_usage) when `path` is not a readable regular file.
  explicit LogReader(const std::filesystem::path& path);
  /// Returns the next event, or nothing at the end of the file.
  std::optional<LogEvent> next();

  /// Starts over and clears the damage counts.
  void rewind();

  [[nodiscard]] const Damage& damage() const { return damage_; }
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }

 private:
  struct Unmap {
    std::size_t size;
    void operator()(const std::byte* bytes) const;
  };
  [[nodiscard]] std::optional<LogEvent> event_at(std::uint64_t offset) const;
  [[nodiscard]] std::uint64_t find_event(std::uint64_t from, std::uint64_t before) const;
  [[nodiscard]] bool is_followed(const LogEvent& event) const;
  void skip(std::uint64_t to);
  void note_number(std::int64_t number);
  void release(std::uint64_t from, std::uint64_t to) const;
  void release_behind();

  std::filesystem::path path_;
  std::unique_ptr<const std::byte[], Unmap> bytes_;
  std::uint64_t size_ = 0;
  std::uint64_t position_ = 0;
  std::uint64_t released_ = 0;
  bool skipping_ = false;     // the last damaged stretch still grows
  std::int64_t number_ = -1;  // number of the last event
  Damage damage_;
};

/// Returns the path of the log for `path`: a file is the log itself. For the directory of a run it
/// is the directory's `lcmlog`. For the directory of several runs (out/NAME) it is the `lcmlog` of
/// the newest run.
std::filesystem::path find_log(const std::filesystem::path& path);

}  // namespace tachless::logger
