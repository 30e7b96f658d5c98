#include "logger/log_file.h"

#include <fcntl.h>
#include <fmt/core.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/types.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <future>
#include <limits>
#include <stdexcept>
#include <system_error>
#include <utility>

#include "base/failure.h"
#include "base/file_descriptor.h"

namespace tachless::logger {
namespace {

constexpr std::uint32_t sync_word = 0xEDA1DA01;
constexpr std::size_t buffer_bytes = 1 << 20;
// liblcm's reader refuses longer names, though the network protocol ends at 63.
constexpr std::size_t max_readable_channel_bytes = 999;
constexpr std::uint64_t smallest_event_bytes = event_header_bytes + 1;
constexpr std::uint64_t release_bytes = 4 << 20;

template <class Integer>
Integer big_endian(Integer value) {
  return static_cast<Integer>(sizeof value == 4 ? htobe32(static_cast<std::uint32_t>(value))
                                                : htobe64(value));
}

template <class Integer>
void put(std::byte* to, Integer value) {
  value = big_endian(value);
  std::memcpy(to, &value, sizeof value);
}

template <class Integer>
Integer get(const std::byte* from) {
  Integer value;
  std::memcpy(&value, from, sizeof value);
  return big_endian(value);
}

/// Writes an event's header and channel. @return their length
std::size_t put_head(std::byte* to, std::int64_t number, std::int64_t utime,
                     std::string_view channel, std::size_t data_bytes) {
  put(to, sync_word);
  put(to + 4, static_cast<std::uint64_t>(number));
  put(to + 12, static_cast<std::uint64_t>(utime));
  put(to + 20, static_cast<std::uint32_t>(channel.size()));
  put(to + 24, static_cast<std::uint32_t>(data_bytes));
  std::memcpy(to + event_header_bytes, channel.data(), channel.size());
  return event_header_bytes + channel.size();
}

std::string text_of(int error) { return std::generic_category().message(error); }

std::string remedy_for_creating(int error, const std::string& directory) {
  switch (error) {
    case EEXIST:
    case ELOOP:
      return "move it away, or name another file";
    case ENOENT:
      return "create the directory " + directory;
    case EACCES:
    case EROFS:
    case EPERM:
      return "name a file in a directory you may write to, not in " + directory;
    case ENOSPC:
      return "free some space on that disk";
    default:
      return "name another file";
  }
}

}  // namespace

LogWriter::LogWriter(std::filesystem::path path)
    : path_(std::move(path)), last_flush_(std::chrono::steady_clock::now()) {
  file_ = open(path_.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC | O_NOFOLLOW | O_EXCL, 0644);
  if (file_ < 0) {
    const int error = errno;
    throw base::bad_usage(
        "{}: cannot create the log: {}; {}", path_.string(), text_of(error),
        remedy_for_creating(
            error, path_.has_parent_path() ? path_.parent_path().string() : std::string(".")));
  }
  buffer_.resize(buffer_bytes);  // touches every page, so that none is missing later
}

LogWriter::~LogWriter() {
  try {
    close();
  } catch (const std::exception&) {
    // The error was thrown before, or the caller has not called close(), which would throw it.
  }
  if (file_ >= 0) ::close(file_);
}

void LogWriter::require_usable() const {
  if (!failure_.empty()) throw base::bad_usage(failure_);
  if (file_ < 0) throw std::logic_error("logger::LogWriter: used after close");
}

void LogWriter::append(std::int64_t utime, std::string_view channel,
                       std::span<const std::byte> data) {
  require_usable();
  if (channel.empty() || channel.size() > max_channel_bytes ||
      data.size() > static_cast<std::size_t>(std::numeric_limits<std::int32_t>::max())) {
    throw std::logic_error("logger::LogWriter: channel name or data of impossible length");
  }
  const std::size_t head = event_header_bytes + channel.size();
  if (filled_ + head + data.size() > buffer_.size()) flush();
  std::byte* const to = &buffer_[filled_];
  put_head(to, num_events_, utime, channel, data.size());
  if (filled_ + head + data.size() <= buffer_.size()) {
    if (!data.empty()) std::memcpy(to + head, data.data(), data.size());
    filled_ += head + data.size();
  } else {  // larger than the whole buffer, which is empty now
    write_out({buffer_.data(), head});
    write_out(data);
    whole_ = written_;
  }
  ++num_events_;
}

void LogWriter::flush() {
  require_usable();
  write_out({buffer_.data(), filled_});
  whole_ = written_;
  filled_ = 0;
}

void LogWriter::flush_if_due(std::chrono::steady_clock::time_point now) {
  require_usable();
  if (now - last_flush_ < flush_interval) return;
  last_flush_ = now;
  if (filled_ != 0) flush();
}

void LogWriter::sync(const Wait& meanwhile) {
  flush();
  const auto on_disk = [file = file_] { return fsync(file) == 0 ? 0 : errno; };
  const auto waited_for = [&] {
    auto result = std::async(std::launch::async, on_disk);
    meanwhile([&] { return result.wait_for(std::chrono::seconds()) == std::future_status::ready; });
    return result.get();
  };
  const int error = meanwhile ? waited_for() : on_disk();
  // A log on something that cannot be synchronised, such as a pipe, is no error.
  if (error != 0 && error != EINVAL && error != EROFS) fail(error);
}

void LogWriter::close() {
  if (failure_.empty() && file_ < 0) return;
  sync();
  require_own_file();
  if (num_events_ == 0) unlink(path_.c_str());
  if (::close(std::exchange(file_, -1)) != 0) fail(errno);
}

/// Throws when the log was removed or replaced. Otherwise nobody would notice until later.
void LogWriter::require_own_file() {
  struct stat open {};
  if (fstat(file_, &open) != 0) fail(errno);
  if (!S_ISREG(open.st_mode)) return;
  struct stat named {};
  const bool exists = stat(path_.c_str(), &named) == 0;
  if (exists && named.st_dev == open.st_dev && named.st_ino == open.st_ino) return;
  ::close(std::exchange(file_, -1));
  failure_ = fmt::format(
      "{}: the log was {} while it was being written; leave it alone until the run has ended",
      path_.string(), exists ? "replaced by another file" : "removed or moved away");
  throw base::bad_usage(failure_);
}

void LogWriter::write_out(std::span<const std::byte> data) {
  while (!data.empty()) {
    const ssize_t n = write(file_, data.data(), data.size());
    if (n < 0) {
      if (errno == EINTR) continue;
      fail(errno);
    }
    written_ += static_cast<std::uint64_t>(n);
    data = data.subspan(static_cast<std::size_t>(n));
  }
}

void LogWriter::fail(int error) {
  // Part of the buffer is in the file. The loop keeps its whole events.
  for (std::size_t at = 0; at < filled_;) {
    const std::uint64_t length = event_header_bytes + get<std::uint32_t>(&buffer_[at + 20]) +
                                 get<std::uint32_t>(&buffer_[at + 24]);
    if (whole_ + length > written_) break;
    whole_ += length;
    at += length;
  }
  filled_ = 0;
  if (file_ >= 0) {
    // If the cut fails, the reader skips the piece of an event and reports it.
    [[maybe_unused]] const int cut = ftruncate(file_, static_cast<off_t>(whole_));
    fsync(file_);
    ::close(std::exchange(file_, -1));
  }
  written_ = whole_;
  const char* remedy = error == ENOSPC || error == EDQUOT
                           ? "free some space on that disk, or name a log on another one"
                       : error == EFBIG ? "raise the limit on file sizes (ulimit -f)"
                                        : "check that disk, or name a log on another one";
  failure_ =
      fmt::format("{}: cannot write the log: {}; the first {} bytes are kept, all whole events; {}",
                  path_.string(), text_of(error), whole_, remedy);
  throw base::bad_usage(failure_);
}

void LogReader::Unmap::operator()(const std::byte* bytes) const {
  munmap(const_cast<std::byte*>(bytes), size);
}

std::string Damage::text() const {
  if (!any()) return "none";
  return fmt::format("{} bytes in {} places hold no message; {} message numbers missing",
                     bytes_skipped, stretches, missing_numbers);
}

void append_event(const std::filesystem::path& path, std::string_view channel,
                  std::span<const std::byte> data) {
  std::int64_t number = -1;
  std::int64_t utime = 0;
  LogReader reader(path);
  while (const auto event = reader.next()) {
    number = event->number;
    utime = event->utime;
  }
  std::vector<std::byte> bytes(event_header_bytes + channel.size() + data.size());
  const std::size_t head = put_head(bytes.data(), number + 1, utime, channel, data.size());
  std::ranges::copy(data, bytes.begin() + static_cast<std::ptrdiff_t>(head));
  const base::FileDescriptor file(open(path.c_str(), O_WRONLY | O_APPEND | O_CLOEXEC | O_NOFOLLOW));
  const off_t end = file.get() < 0 ? 0 : lseek(file.get(), 0, SEEK_END);
  const ssize_t written = file.get() < 0 ? -1 : write(file.get(), bytes.data(), bytes.size());
  if (written == static_cast<ssize_t>(bytes.size())) return;
  const int error = written < 0 ? errno : ENOSPC;
  if (written > 0) [[maybe_unused]]
    const int cut = ftruncate(file.get(), end);
  throw base::bad_usage("{}: the cause of the run's end cannot be added to the log: {}",
                        path.string(), text_of(error));
}

LogReader::LogReader(const std::filesystem::path& path) : path_(path) {
  const auto refuse = [&](const std::string& problem) {
    throw base::bad_usage("{}: cannot read the log: {}", path.string(), problem);
  };
  const base::FileDescriptor file(open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  if (file.get() < 0) refuse(text_of(errno) + "; name an LCM log");
  struct stat status {};
  if (fstat(file.get(), &status) != 0 || !S_ISREG(status.st_mode)) {
    refuse("it is not a regular file; name an LCM log");
  }
  if (status.st_size > 0) {
    size_ = static_cast<std::uint64_t>(status.st_size);
    void* const mapped = mmap(nullptr, size_, PROT_READ, MAP_PRIVATE, file.get(), 0);
    if (mapped == MAP_FAILED) refuse(text_of(errno));
    bytes_ = {static_cast<const std::byte*>(mapped), Unmap{size_}};
    madvise(mapped, size_, MADV_SEQUENTIAL);
  }
  rewind();
}

void LogReader::rewind() {
  position_ = 0;
  released_ = 0;
  skipping_ = false;
  number_ = -1;
  damage_ = {};
}

std::optional<LogEvent> LogReader::next() {
  while (position_ < size_) {
    const auto event = event_at(position_);
    if (event && (!is_followed(*event) || event->number - 1 != number_)) {
      // Damage follows the event, or its own length is damaged and it spans later events. Garbage
      // that looks like an event may span later events too.
      const std::uint64_t inner = find_event(position_ + 1, event->end());
      if (inner < event->end()) {
        skip(inner);
        continue;
      }
    }
    if (!event) {
      skip(find_event(position_ + 1, size_));
      continue;
    }
    skipping_ = false;
    note_number(event->number);
    position_ = event->end();
    release_behind();
    return event;
  }
  return std::nullopt;
}

/// Returns the event at `offset` if it is plausible and lies wholly in the file.
std::optional<LogEvent> LogReader::event_at(std::uint64_t offset) const {
  if (offset > size_ || size_ - offset < smallest_event_bytes) return std::nullopt;
  const std::byte* at = &bytes_[offset];
  if (get<std::uint32_t>(at) != sync_word) return std::nullopt;
  const auto number = static_cast<std::int64_t>(get<std::uint64_t>(at + 4));
  const auto channel_bytes = get<std::uint32_t>(at + 20);
  const auto data_bytes = get<std::uint32_t>(at + 24);
  if (number < 0 || channel_bytes == 0 || channel_bytes > max_readable_channel_bytes ||
      data_bytes > static_cast<std::uint32_t>(std::numeric_limits<std::int32_t>::max()) ||
      offset + event_header_bytes + channel_bytes + data_bytes > size_) {
    return std::nullopt;
  }
  LogEvent event;
  event.number = number;
  event.utime = static_cast<std::int64_t>(get<std::uint64_t>(at + 12));
  event.channel = {reinterpret_cast<const char*>(at) + event_header_bytes, channel_bytes};
  event.data = {at + event_header_bytes + channel_bytes, data_bytes};
  event.offset = offset;
  const bool printable =
      std::ranges::all_of(event.channel, [](char c) { return c >= 0x20 && c < 0x7f; });
  return printable ? std::optional(event) : std::nullopt;
}

/// Returns the offset of the first plausible event in [from, before), or `before` without one.
std::uint64_t LogReader::find_event(std::uint64_t from, std::uint64_t before) const {
  const std::uint32_t sync = big_endian(sync_word);
  while (from < before) {
    // The search may read gigabytes, so it releases each piece.
    const std::uint64_t end = std::min(before, from + release_bytes);
    const void* found = memmem(&bytes_[from], std::min(end + 3, size_) - from, &sync, sizeof sync);
    if (found == nullptr) {
      release(from, end);
      from = end;
      continue;
    }
    const auto offset =
        static_cast<std::uint64_t>(static_cast<const std::byte*>(found) - &bytes_[0]);
    if (event_at(offset)) return offset;
    from = offset + 1;
  }
  return before;
}

/// Returns true if the file ends after `event`, or the next event begins there, whole or not.
bool LogReader::is_followed(const LogEvent& event) const {
  const std::uint64_t end = event.end();
  if (end == size_) return true;
  return size_ - end >= 12 && get<std::uint32_t>(&bytes_[end]) == sync_word &&
         get<std::uint64_t>(&bytes_[end + 4]) == static_cast<std::uint64_t>(event.number) + 1;
}

void LogReader::skip(std::uint64_t to) {
  const std::uint64_t bytes = to - position_;
  if (!skipping_) {
    ++damage_.stretches;
    if (damage_.listed.size() < Damage::max_listed) damage_.listed.push_back({position_, 0});
  }
  if (damage_.stretches == damage_.listed.size()) damage_.listed.back().bytes += bytes;
  damage_.bytes_skipped += bytes;
  skipping_ = true;
  position_ = to;
  release_behind();
}

void LogReader::note_number(std::int64_t number) {
  if (number <= number_) {
    ++damage_.numbers_restarted;
  } else {  // -1 stands before the first
    damage_.missing_numbers +=
        static_cast<std::uint64_t>(number) - static_cast<std::uint64_t>(number_) - 1;
  }
  number_ = number;
}

/// Releases pages that have been read. Another reading loads them from the file again.
void LogReader::release(std::uint64_t from, std::uint64_t to) const {
  constexpr std::uint64_t page = 4096;
  const std::uint64_t begin = (from + page - 1) / page * page, end = to / page * page;
  if (begin < end) madvise(const_cast<std::byte*>(&bytes_[begin]), end - begin, MADV_DONTNEED);
}

void LogReader::release_behind() {
  while (position_ - released_ >= 2 * release_bytes) {
    release(released_, released_ + release_bytes);
    released_ += release_bytes;
  }
}

std::filesystem::path find_log(const std::filesystem::path& path) {
  namespace fs = std::filesystem;
  std::error_code error;
  if (!fs::is_directory(path, error)) return path;
  const fs::path latest = fs::read_symlink(path / "latest", error);
  if (!error && fs::exists(path / latest / "lcmlog", error)) return path / latest / "lcmlog";
  fs::path newest = path;  // a run's name is its time
  if (!fs::exists(path / "lcmlog", error)) {
    for (const auto& entry : fs::directory_iterator(path, error)) {
      const bool run = !entry.is_symlink(error) && fs::exists(entry.path() / "lcmlog", error);
      if (run && (newest == path || entry.path() > newest)) newest = entry.path();
    }
  }
  return newest / "lcmlog";
}

}  // namespace tachless::logger
