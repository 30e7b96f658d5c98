#include "logger/mcap.h"

#include <cerrno>
#include <concepts>
#include <system_error>

namespace tachless::logger {
namespace {

constexpr std::string_view magic("\x89MCAP0\r\n", 8);
constexpr std::size_t chunk_bytes = 1 << 20;

enum class Op : unsigned char {
  header = 1,
  footer,
  schema,
  channel,
  message,
  chunk,
  message_index,
  chunk_index,
  statistics = 0x0B,
  data_end = 0x0F
};

/// The content of a record: little-endian numbers, and texts with their lengths before them.
class Record {
 public:
  template <std::unsigned_integral Number>
  Record& put(Number number) {
    for (std::size_t i = 0; i < sizeof(Number); ++i) {
      bytes_ += static_cast<char>(static_cast<std::uint64_t>(number) >> (8 * i) & 0xFFU);
    }
    return *this;
  }
  Record& put(std::string_view text) {
    put(static_cast<std::uint32_t>(text.size()));
    bytes_ += text;
    return *this;
  }
  /// A map or list: its length in bytes, then what `fill` puts.
  template <class Fill>
  Record& put_all(const Fill& fill) {
    Record all;
    fill(all);
    return put(all.bytes_);
  }
  Record& put_raw(std::string_view bytes) {
    bytes_ += bytes;
    return *this;
  }
  [[nodiscard]] std::string as(Op op) const {
    Record head;
    head.put(static_cast<std::uint8_t>(op)).put(std::uint64_t{bytes_.size()});
    return head.bytes_ + bytes_;
  }

 private:
  std::string bytes_;
};

[[noreturn]] void fail() { throw std::system_error(errno, std::generic_category()); }

}  // namespace

McapWriter::McapWriter(const std::filesystem::path& path) : file_(std::fopen(path.c_str(), "we")) {
  if (file_ == nullptr) fail();
  write(magic);
  write(Record().put(std::string_view()).put(std::string_view("tachless")).as(Op::header));
}

McapWriter::~McapWriter() {
  if (file_ != nullptr) std::fclose(file_);
}

std::uint16_t McapWriter::add_channel(std::string_view topic, std::string_view schema_name,
                                      std::string_view schema) {
  const std::uint16_t id = ++num_channels_;  // 0 would be: without a schema
  schemas_ += Record()
                  .put(id)
                  .put(schema_name)
                  .put(std::string_view("jsonschema"))
                  .put(schema)
                  .as(Op::schema);
  channels_ += Record()
                   .put(id)
                   .put(id)
                   .put(topic)
                   .put(std::string_view("json"))
                   .put_all([](Record&) {})
                   .as(Op::channel);
  return id;
}

void McapWriter::add(std::uint16_t channel, std::uint64_t time_ns, std::string_view json) {
  if (chunk_.empty()) {
    if (chunks_.empty()) chunk_ = schemas_ + channels_;
    begin_ns_ = time_ns;
  }
  end_ns_ = time_ns;
  index_[channel].emplace_back(time_ns, chunk_.size());
  const auto sequence = static_cast<std::uint32_t>(counts_[channel]++);
  chunk_ +=
      Record().put(channel).put(sequence).put(time_ns).put(time_ns).put_raw(json).as(Op::message);
  if (chunk_.size() >= chunk_bytes) end_chunk();
}

void McapWriter::end_chunk() {
  if (chunk_.empty()) return;
  Chunk chunk{begin_ns_, end_ns_, written_, 0, chunk_.size(), 0, {}};
  write(Record()
            .put(begin_ns_)
            .put(end_ns_)
            .put(std::uint64_t{chunk_.size()})
            .put(std::uint32_t{0})  // no checksum
            .put(std::string_view())
            .put(std::uint64_t{chunk_.size()})
            .put_raw(chunk_)
            .as(Op::chunk));
  chunk.length = written_ - chunk.offset;
  for (const auto& [channel, entries] : index_) {
    chunk.indexes[channel] = written_;
    write(Record()
              .put(channel)
              .put_all([&entries = entries](Record& all) {
                for (const auto& [time_ns, offset] : entries) all.put(time_ns).put(offset);
              })
              .as(Op::message_index));
  }
  chunk.index_length = written_ - chunk.offset - chunk.length;
  chunks_.push_back(chunk);
  chunk_.clear();
  index_.clear();
}

void McapWriter::write_summary() {
  const std::uint64_t begin = written_;
  write(schemas_ + channels_);
  for (const Chunk& chunk : chunks_) {
    write(Record()
              .put(chunk.begin_ns)
              .put(chunk.end_ns)
              .put(chunk.offset)
              .put(chunk.length)
              .put_all([&](Record& all) {
                for (const auto& [channel, offset] : chunk.indexes) all.put(channel).put(offset);
              })
              .put(chunk.index_length)
              .put(std::string_view())
              .put(chunk.size)
              .put(chunk.size)
              .as(Op::chunk_index));
  }
  std::uint64_t messages = 0;
  for (const auto& [channel, count] : counts_) messages += count;
  write(Record()
            .put(messages)
            .put(num_channels_)
            .put(std::uint32_t{num_channels_})
            .put(std::uint32_t{0})  // attachments
            .put(std::uint32_t{0})  // metadata
            .put(static_cast<std::uint32_t>(chunks_.size()))
            .put(chunks_.empty() ? 0 : chunks_.front().begin_ns)
            .put(chunks_.empty() ? 0 : chunks_.back().end_ns)
            .put_all([&](Record& all) {
              for (const auto& [channel, count] : counts_) all.put(channel).put(count);
            })
            .as(Op::statistics));
  // No offsets of groups, no checksum.
  write(Record().put(begin).put(std::uint64_t{0}).put(std::uint32_t{0}).as(Op::footer));
}

void McapWriter::close() {
  end_chunk();
  write(Record().put(std::uint32_t{0}).as(Op::data_end));
  write_summary();
  write(magic);
  if (std::fclose(std::exchange(file_, nullptr)) != 0) fail();
}

void McapWriter::write(std::string_view bytes) {
  if (std::fwrite(bytes.data(), 1, bytes.size(), file_) != bytes.size()) fail();
  written_ += bytes.size();
}

}  // namespace tachless::logger
