#pragma once

#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace tachless::logger {

/// Writer of an MCAP file (https://mcap.dev/spec) of JSON messages. The file has uncompressed
/// chunks, each with an index of its messages, and a summary, so that readers find any time at
/// once. It is written front to back, with one chunk in memory.
class McapWriter {
 public:
  /// Opens the file and overwrites it.
  /// @throw std::system_error when `path` cannot be written, as the other functions do
  explicit McapWriter(const std::filesystem::path& path);
  McapWriter(const McapWriter&) = delete;
  McapWriter& operator=(const McapWriter&) = delete;
  ~McapWriter();

  /// Adds a channel with its own JSON schema.
  /// @return its number, for `add`
  std::uint16_t add_channel(std::string_view topic, std::string_view schema_name,
                            std::string_view schema);

  /// Adds a message.
  /// @param time_ns since the run's start; not below the time of the message before
  void add(std::uint16_t channel, std::uint64_t time_ns, std::string_view json);

  void close();

 private:
  struct Chunk {
    std::uint64_t begin_ns = 0, end_ns = 0, offset = 0, length = 0, size = 0, index_length = 0;
    std::map<std::uint16_t, std::uint64_t> indexes;  ///< offsets in the file, by channel
  };

  void write(std::string_view bytes);
  void end_chunk();
  /// Writes the summary, from the file's present end on, and the footer.
  void write_summary();

  std::FILE* file_ = nullptr;
  std::uint64_t written_ = 0;
  std::string schemas_, channels_;  ///< records of schemas and channels, which the summary repeats
  std::uint16_t num_channels_ = 0;
  std::string chunk_;  ///< records of the current chunk
  std::uint64_t begin_ns_ = 0, end_ns_ = 0;
  std::map<std::uint16_t, std::vector<std::pair<std::uint64_t, std::uint64_t>>> index_;
  std::map<std::uint16_t, std::uint64_t> counts_;  ///< messages, by channel
  std::vector<Chunk> chunks_;
};

}  // namespace tachless::logger
