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
#include <limits>
#include <stdexcept>
#include <system_error>
#include <utility>

#include "diagnostics/failure.h"
#include "process/file_descriptor.h"

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

std::string text_of(int error) { return std::generic_category().message(error); }

std::string remedy_for_creating(int error, const std::string& directory) {
  switch (error) {
    case EEXIST:
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

/// Whether `event` can come after `earlier` with nothing but events between them: each takes room.
bool could_follow(const LogEvent& event, const LogEvent& earlier) {
  return event.number > earlier.number &&
         static_cast<std::uint64_t>(event.number - earlier.number) <=
             1 + (event.offset - earlier.offset) / smallest_event_bytes;
}

}  // namespace

LogWriter::LogWriter(std::filesystem::path path, Existing existing)
    : path_(std::move(path)), last_flush_(std::chrono::steady_clock::now()) {
  const int policy = existing == Existing::refuse ? O_EXCL : O_TRUNC;
  file_ = open(path_.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC | policy, 0644);
  if (file_ < 0) {
    const int error = errno;
    throw diagnostics::bad_usage(
        "{}: cannot create the log: {}; {}", path_.string(), text_of(error),
        remedy_for_creating(
            error, path_.has_parent_path() ? path_.parent_path().string() : std::string(".")));
  }
  buffer_.resize(buffer_bytes);  // touches every page, so that none is missing later
}

LogWriter::~LogWriter() {
  if (file_ < 0) return;
  try {
    flush();
  } catch (const std::exception&) {
    // The error was thrown before, or its time to be heard, close(), was let pass.
  }
  if (file_ >= 0) ::close(file_);
}

void LogWriter::require_usable() const {
  if (!failure_.empty()) throw diagnostics::bad_usage(failure_);
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
  put(to, sync_word);
  put(to + 4, static_cast<std::uint64_t>(num_events_));
  put(to + 12, static_cast<std::uint64_t>(utime));
  put(to + 20, static_cast<std::uint32_t>(channel.size()));
  put(to + 24, static_cast<std::uint32_t>(data.size()));
  std::memcpy(to + event_header_bytes, channel.data(), channel.size());
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
  require_own_file();
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

void LogWriter::sync() {
  flush();
  // A log on something that cannot be synchronised, such as a pipe, is no error.
  if (fsync(file_) != 0 && errno != EINVAL && errno != EROFS) fail(errno);
}

void LogWriter::close() {
  if (failure_.empty() && file_ < 0) return;
  sync();
  if (::close(std::exchange(file_, -1)) != 0) fail(errno);
}

void LogWriter::require_own_file() {
  struct stat open {};
  if (fstat(file_, &open) != 0) fail(errno);
  if (!S_ISREG(open.st_mode)) return;
  struct stat named {};
  const bool exists = stat(path_.c_str(), &named) == 0;
  const bool same = exists && named.st_dev == open.st_dev && named.st_ino == open.st_ino;
  const auto size = static_cast<std::uint64_t>(open.st_size);
  if (same && size == written_) return;
  const std::string what = !exists ? "was removed or moved away"
                           : !same ? "was replaced by another file"
                                   : "was " + std::to_string(written_) + " bytes long and has " +
                                         std::to_string(size) + " now";
  filled_ = 0;
  ::close(std::exchange(file_, -1));
  failure_ = path_.string() + ": the log " + what +
             " while it was being written; leave it alone until the run has ended";
  throw diagnostics::bad_usage(failure_);
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
  // What the buffer still holds went out in part: keep its whole events.
  for (std::size_t at = 0; at < filled_;) {
    const std::uint64_t length = event_header_bytes + get<std::uint32_t>(&buffer_[at + 20]) +
                                 get<std::uint32_t>(&buffer_[at + 24]);
    if (whole_ + length > written_) break;
    whole_ += length;
    at += length;
  }
  filled_ = 0;
  if (file_ >= 0) {
    // Where cutting fails, the reader skips the piece of an event and says so.
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
  throw diagnostics::bad_usage(failure_);
}

void LogReader::Unmap::operator()(const std::byte* bytes) const {
  munmap(const_cast<std::byte*>(bytes), size);
}

LogReader::LogReader(const std::filesystem::path& path) : path_(path) {
  const auto refuse = [&](const std::string& problem) {
    throw diagnostics::bad_usage("{}: cannot read the log: {}", path.string(), problem);
  };
  const process::FileDescriptor file(open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
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
  // Damage by accident needs one look per damaged event; a log made to be slow gets no more than
  // this, so that reading stays linear in the file's length.
  look_ahead_left_ = 8 * size_ + (1 << 20);
  skipping_ = false;
  last_ = {};
  last_.number = -1;
  damage_ = {};
}

std::optional<LogEvent> LogReader::next() {
  while (position_ < size_) {
    auto event = event_at(position_);
    if (event && (skipping_ || !number_follows(event->end(), event->number + 1))) {
      // Damage comes before or after, or the numbers jump, or the file ends: does this length
      // span more than its own event?
      if (swallows_others(*event)) {
        event.reset();
      } else {
        event->suspect = event->end() != size_ && !event_at(event->end());
      }
    }
    if (!event) {
      const auto next_event = find_event(position_ + 1, size_);
      skip(next_event ? next_event->offset : size_);
      continue;
    }
    skipping_ = false;
    note_number(*event);
    if (event->suspect) ++damage_.suspect_messages;
    position_ = event->end();
    release_behind();
    return event;
  }
  return std::nullopt;
}

/// A plausible event that lies wholly in the file.
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

/// The first plausible event that begins in [from, before).
std::optional<LogEvent> LogReader::find_event(std::uint64_t from, std::uint64_t before) const {
  const std::uint32_t sync = big_endian(sync_word);
  while (from < before) {
    const void* found =
        memmem(&bytes_[from], std::min(before + 3, size_) - from, &sync, sizeof sync);
    if (found == nullptr) return std::nullopt;
    const auto offset =
        static_cast<std::uint64_t>(static_cast<const std::byte*>(found) - &bytes_[0]);
    if (const auto event = event_at(offset)) return event;
    from = offset + 1;
  }
  return std::nullopt;
}

/// Whether an event `number` begins at `offset`, be it whole or not.
bool LogReader::number_follows(std::uint64_t offset, std::int64_t number) const {
  return size_ - offset >= 12 && get<std::uint32_t>(&bytes_[offset]) == sync_word &&
         get<std::uint64_t>(&bytes_[offset + 4]) == static_cast<std::uint64_t>(number);
}

/// Whether `event`, which has damage beside it, spans events of its own log: then its lengths are
/// damaged. A log within a message is not taken for that as long as its numbers do not fit and it
/// ends with the message.
bool LogReader::swallows_others(const LogEvent& event) {
  const std::uint64_t end = event.end();
  const bool aligned = end == size_ || event_at(end);
  const bool fits = could_follow(event, last_);
  std::uint64_t from = event.offset + 1;
  while (from < end && look_ahead_left_ != 0) {
    const auto inner = find_event(from, end);
    const std::uint64_t looked = (inner ? inner->offset + 1 : end) - from;
    look_ahead_left_ -= std::min(look_ahead_left_, looked);
    if (!inner) return false;
    if (could_follow(*inner, event) || (!fits && could_follow(*inner, last_))) return true;
    LogEvent link = *inner;
    bool is_chain = false;
    while (link.end() < end && number_follows(link.end(), link.number + 1)) {
      const auto successor = event_at(link.end());
      if (!successor) break;
      link = *successor;
      is_chain = true;
    }
    if (link.end() == end && number_follows(end, link.number + 1)) return true;
    if (link.end() != end && (!aligned || (is_chain && link.end() > end))) return true;
    from = link.offset + 1;
  }
  return false;
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

void LogReader::note_number(const LogEvent& event) {
  const std::int64_t expected = last_.number + 1;
  std::int64_t number = event.number;
  if (number != expected) {
    const bool chained = number_follows(event.end(), number + 1);
    if (number_follows(event.end(), expected + 1) ||
        (!chained && !could_follow(event, last_) && number != 0)) {
      ++damage_.wrong_numbers;
      number = expected;
    } else if (number > expected) {
      damage_.missing_numbers += static_cast<std::uint64_t>(number - expected);
    } else {
      ++damage_.numbers_restarted;
    }
  }
  last_.number = number;
  last_.offset = event.offset;
}

void LogReader::release_behind() {
  // Pages already read may go; they come back from the file should somebody look again.
  while (position_ - released_ >= 2 * release_bytes) {
    madvise(const_cast<std::byte*>(&bytes_[released_]), release_bytes, MADV_DONTNEED);
    released_ += release_bytes;
  }
}

}  // namespace tachless::logger
