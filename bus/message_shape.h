#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "bus/wire.h"

namespace tachless::bus {

/// One field of a message as it lies in the datagram, in the order of its .lcm file.
struct Field {
  enum class Kind {
    int64,
    int32,
    int8,
    boolean,  ///< one byte, 0 or 1
    real,     ///< 8 bytes, finite
    count,    ///< int32 that must equal `number`
    text,     ///< int32 length with the NUL, characters, NUL; at most `number` characters
  };
  Kind kind;
  int number = 1;  ///< how many in a row; of count and text see above
};

/// What the bytes of one message type must look like for one layout. Looks at raw bytes only, so
/// that a hostile length or count never reaches a generated decoder.
class MessageShape {
 public:
  /// @param fingerprint LCM's hash of the type
  /// @param fields everything after the fingerprint, `utime`, `run` and `tick`
  /// @param max_size bytes, for messages with texts; 0: as follows from the fields
  MessageShape(std::int64_t fingerprint, std::vector<Field> fields, std::size_t max_size = 0);

  /// Size, fingerprint, then every field in turn.
  [[nodiscard]] Rejection check(std::span<const std::byte> payload) const;

  /// Size in bytes of the largest message of this shape; of the only one if it holds no text.
  [[nodiscard]] std::size_t max_size() const { return max_size_; }

 private:
  std::int64_t fingerprint_;
  std::vector<Field> fields_;
  std::size_t min_size_;
  std::size_t max_size_;
};

}  // namespace tachless::bus
