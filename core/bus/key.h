#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>

/// The key of a bus, how it is read, and the digests that are made with a key or without. Knows no
/// message.
namespace tachless::bus {

/// The secret that all participants of a bus share. Copies share one allocation, which is locked in
/// memory where the system's limit (`ulimit -l`) allows it, is in no core dump, and is wiped with
/// the last copy. Not for the hot path: each key takes some pages.
class Key {
 public:
  static constexpr std::size_t size = 32;
  /// Zeros, until they are written over.
  /// @throw std::runtime_error if the machine's cryptographic library cannot be used
  Key();

  std::span<unsigned char, size> bytes() {
    return std::span<unsigned char, size>(bytes_.get(), size);
  }
  [[nodiscard]] std::span<const unsigned char, size> bytes() const {
    return std::span<const unsigned char, size>(bytes_.get(), size);
  }

 private:
  std::shared_ptr<unsigned char> bytes_;
};

/// The key in `path`: 32 bytes, or 64 hexadecimal digits with or without an end of line; nothing
/// where the path is empty. With a key this process's memory is private from then on
/// (core/base/this_process.h).
/// @throw Failure(bad_usage) naming the path, never its content: not a readable regular file,
/// another length, readable by others than its owner, nothing but zeros; and where the path is
/// empty while the variable TACHLESS_KEY_FILE is set.
std::optional<Key> read_key_file(const std::filesystem::path& path);

/// Returns a positive random number that nobody can guess.
/// @throw std::runtime_error if the machine's cryptographic library cannot be used
std::int64_t random_number();

/// BLAKE2b of all bytes added so far, in their order. With a key it is a message authentication
/// code; without one it proves no origin.
class Digest {
 public:
  /// @param size of the whole digest [bytes], 16 to 64
  /// @throw std::runtime_error if the machine's cryptographic library cannot be used
  explicit Digest(std::size_t size = 16, const Key* key = nullptr);
  Digest(const Digest&) = default;
  Digest& operator=(const Digest&) = default;
  ~Digest();  ///< wipes its state

  void add(std::span<const std::byte> bytes);
  /// The whole, to as many bytes; nothing can be added afterwards.
  void finish(std::span<unsigned char> digest);
  /// The first 64 bits of it, in network order: the same number on every host.
  [[nodiscard]] std::int64_t value() const;

 private:
  // Storage of crypto_generichash_state.
  alignas(64) std::array<unsigned char, 384> state_{};
  std::size_t size_;
};

}  // namespace tachless::bus
