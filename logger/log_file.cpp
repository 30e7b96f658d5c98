// More than 400 lines: writer and reader in one file, because the bytes of an event's header
// stand here alone.
#include "logger/log_file.h"

#include <fcntl.h>
#include <fmt/core.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cerrno>
#include <cstring>
#include <limits>
#include <stdexcept>
#include <system_error>
#include <utility>

#include "diagnostics/failure.h"

namespace tachless::logger {
namespace {

constexpr std::uint32_t sync_word = 0xEDA1DA01;
constexpr std::array<std::byte, 4> sync_bytes = {std::byte{0xED}, std::byte{0xA1}, std::byte{0xDA},
                                                 std::byte{0x01}};
constexpr std::size_t buffer_bytes = 1 << 20;
// liblcm's reader refuses longer names, though the network protocol ends at 63.
constexpr std::size_t max_readable_channel_bytes = 999;
constexpr std::uint64_t smallest_event_bytes = event_header_bytes + 1;
constexpr std::uint64_t release_bytes = 4 << 20;

template <class Integer>
Integer big_endian(Integer value) {
  if constexpr (std::endian::native == std::endian::little) {
    if constexpr (sizeof(Integer) == 4) {
      return __builtin_bswap32(value);
    } else {
      return __builtin_bswap64(value);
    }
  }
  return value;
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

void put_header(std::byte* to, std::int64_t number, std::int64_t utime, std::size_t channel_bytes,
                std::size_t data_bytes) {
  put(to, sync_word);
  put(to + 4, static_cast<std::uint64_t>(number));
  put(to + 12, static_cast<std::uint64_t>(utime));
  put(to + 20, static_cast<std::uint32_t>(channel_bytes));
  put(to + 24, static_cast<std::uint32_t>(data_bytes));
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

/// Whether an event `number` at `offset` can come after event `earlier` at `earlier_offset` with
/// nothing but events between them: each takes room.
bool could_follow(std::int64_t number, std::uint64_t offset, std::int64_t earlier,
                  std::uint64_t earlier_offset) {
  return number > earlier && static_cast<std::uint64_t>(number - earlier) <=
                                 1 + (offset - earlier_offset) / smallest_event_bytes;
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
  put_header(&buffer_[filled_], num_events_, utime, channel.size(), data.size());
  std::memcpy(&buffer_[filled_ + event_header_bytes], channel.data(), channel.size());
  if (filled_ + head + data.size() <= buffer_.size()) {
    if (!data.empty()) std::memcpy(&buffer_[filled_ + head], data.data(), data.size());
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

LogReader::LogReader(const std::filesystem::path& path) : path_(path) {
  const auto refuse = [&](const std::string& problem) {
    throw diagnostics::bad_usage("{}: cannot read the log: {}", path.string(), problem);
  };
  const int file = open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (file < 0) refuse(text_of(errno) + "; name an LCM log");
  struct stat status {};
  const bool regular = fstat(file, &status) == 0 && S_ISREG(status.st_mode);
  void* mapped = nullptr;
  int error = 0;
  if (regular && status.st_size > 0) {
    size_ = static_cast<std::uint64_t>(status.st_size);
    mapped = mmap(nullptr, size_, PROT_READ, MAP_PRIVATE, file, 0);
    if (mapped == MAP_FAILED) error = errno;
  }
  ::close(file);
  if (!regular) refuse("it is not a regular file; name an LCM log");
  if (error != 0) refuse(text_of(error));
  bytes_ = static_cast<const std::byte*>(mapped);
  if (size_ != 0) madvise(mapped, size_, MADV_SEQUENTIAL);
  rewind();
}

LogReader::LogReader(LogReader&& other) noexcept
    : path_(std::move(other.path_)),
      bytes_(std::exchange(other.bytes_, nullptr)),
      size_(std::exchange(other.size_, 0)),
      position_(std::exchange(other.position_, 0)),
      released_(other.released_),
      look_ahead_left_(other.look_ahead_left_),
      skipping_(other.skipping_),
      last_number_(other.last_number_),
      last_offset_(other.last_offset_),
      damage_(std::move(other.damage_)) {}

LogReader::~LogReader() {
  if (bytes_ != nullptr) munmap(const_cast<std::byte*>(bytes_), size_);
}

void LogReader::rewind() {
  position_ = 0;
  released_ = 0;
  // Damage by accident needs one look per damaged event; a log made to be slow gets no more than
  // this, so that reading stays linear in the file's length.
  look_ahead_left_ = 8 * size_ + (1 << 20);
  skipping_ = false;
  last_number_ = -1;
  last_offset_ = 0;
  damage_ = {};
}

std::optional<LogEvent> LogReader::next() {
  while (position_ < size_) {
    const auto header = header_at(position_);
    bool is_event = header.has_value();
    bool suspect = false;
    if (is_event && (skipping_ || !number_follows(header->end, header->number + 1))) {
      // Damage comes before or after, or the numbers jump, or the file ends: does this length
      // span more than its own event?
      is_event = !swallows_others(*header);
      suspect = is_event && header->end != size_ && !header_at(header->end);
    }
    if (!is_event) {
      const auto next_header = find_header(position_ + 1, size_);
      skip(next_header ? next_header->offset : size_);
      continue;
    }
    skipping_ = false;
    note_number(*header);
    if (suspect) ++damage_.suspect_events;
    const std::byte* at = bytes_ + position_;
    const std::size_t head = event_header_bytes + header->channel_bytes;
    LogEvent event;
    event.number = header->number;
    event.utime = static_cast<std::int64_t>(get<std::uint64_t>(at + 12));
    event.channel = {reinterpret_cast<const char*>(at) + event_header_bytes, header->channel_bytes};
    event.data = {at + head, static_cast<std::size_t>(header->end - position_ - head)};
    event.offset = position_;
    event.suspect = suspect;
    position_ = header->end;
    release_behind();
    return event;
  }
  return std::nullopt;
}

/// A plausible event that lies wholly in the file.
std::optional<LogReader::Header> LogReader::header_at(std::uint64_t offset) const {
  if (offset > size_ || size_ - offset < smallest_event_bytes) return std::nullopt;
  const std::byte* at = bytes_ + offset;
  if (get<std::uint32_t>(at) != sync_word) return std::nullopt;
  const auto number = static_cast<std::int64_t>(get<std::uint64_t>(at + 4));
  const auto channel_bytes = get<std::uint32_t>(at + 20);
  const auto data_bytes = get<std::uint32_t>(at + 24);
  if (number < 0 || channel_bytes == 0 || channel_bytes > max_readable_channel_bytes ||
      data_bytes > static_cast<std::uint32_t>(std::numeric_limits<std::int32_t>::max())) {
    return std::nullopt;
  }
  const std::uint64_t end = offset + event_header_bytes + channel_bytes + data_bytes;
  if (end > size_) return std::nullopt;
  const auto* channel = reinterpret_cast<const unsigned char*>(at) + event_header_bytes;
  const bool printable = std::all_of(channel, channel + channel_bytes,
                                     [](unsigned char c) { return c >= 0x20 && c < 0x7f; });
  if (!printable) return std::nullopt;
  return Header{number, offset, end, channel_bytes};
}

/// The first plausible event that begins in [from, before).
std::optional<LogReader::Header> LogReader::find_header(std::uint64_t from,
                                                        std::uint64_t before) const {
  while (from < before) {
    const void* found = memmem(bytes_ + from, std::min(before + 3, size_) - from, sync_bytes.data(),
                               sync_bytes.size());
    if (found == nullptr) return std::nullopt;
    const auto offset = static_cast<std::uint64_t>(static_cast<const std::byte*>(found) - bytes_);
    if (const auto header = header_at(offset)) return header;
    from = offset + 1;
  }
  return std::nullopt;
}

/// Whether an event `number` begins at `offset`, be it whole or not.
bool LogReader::number_follows(std::uint64_t offset, std::int64_t number) const {
  return size_ - offset >= 12 && get<std::uint32_t>(bytes_ + offset) == sync_word &&
         get<std::uint64_t>(bytes_ + offset + 4) == static_cast<std::uint64_t>(number);
}

/// Whether `header`, which has damage beside it, spans events of its own log: then its lengths are
/// damaged. A log within a message is not taken for that as long as its numbers do not fit and it
/// ends with the message.
bool LogReader::swallows_others(const Header& header) {
  const bool aligned = header.end == size_ || header_at(header.end);
  const bool fits = could_follow(header.number, header.offset, last_number_, last_offset_);
  std::uint64_t from = header.offset + 1;
  while (from < header.end && look_ahead_left_ != 0) {
    const auto inner = find_header(from, header.end);
    const std::uint64_t looked = (inner ? inner->offset + 1 : header.end) - from;
    look_ahead_left_ -= std::min(look_ahead_left_, looked);
    if (!inner) return false;
    if (could_follow(inner->number, inner->offset, header.number, header.offset)) return true;
    if (!fits && could_follow(inner->number, inner->offset, last_number_, last_offset_)) {
      return true;
    }
    Header link = *inner;
    bool is_chain = false;
    while (link.end < header.end && number_follows(link.end, link.number + 1)) {
      const auto successor = header_at(link.end);
      if (!successor) break;
      link = *successor;
      is_chain = true;
    }
    if (link.end == header.end && number_follows(link.end, link.number + 1)) return true;
    if (link.end != header.end && (!aligned || (is_chain && link.end > header.end))) return true;
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

void LogReader::note_number(const Header& header) {
  const std::int64_t expected = last_number_ + 1;
  std::int64_t number = header.number;
  if (number != expected) {
    const bool chained = number_follows(header.end, number + 1);
    if (number_follows(header.end, expected + 1) ||
        (!chained && !could_follow(number, header.offset, last_number_, last_offset_) &&
         number != 0)) {
      ++damage_.wrong_numbers;
      number = expected;
    } else if (number > expected) {
      damage_.missing_numbers += static_cast<std::uint64_t>(number - expected);
    } else {
      ++damage_.numbers_restarted;
    }
  }
  last_number_ = number;
  last_offset_ = header.offset;
}

void LogReader::release_behind() {
  // Pages already read may go; they come back from the file should somebody look again.
  while (position_ - released_ >= 2 * release_bytes) {
    madvise(const_cast<std::byte*>(bytes_) + released_, release_bytes, MADV_DONTNEED);
    released_ += release_bytes;
  }
}

}  // namespace tachless::logger
