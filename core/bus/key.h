#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>

/// The key of a bus, its file, and digests with or without a key. This header knows no message.
namespace tachless::bus {

/// The secret that all participants of a bus share. Copies share one allocation. The allocation is
/// locked in memory if the system's limit (`ulimit -l`) allows it. It is in no core dump, and it is
/// wiped with the last copy. Do not make keys in the hot path: each key takes some pages.
class Key {
 public:
  static constexpr std::size_t size = 32;
  /// Makes a key of zeros, to be overwritten.
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

/// Returns the key in `path`: 32 bytes, or 64 hexadecimal digits with or without an end of line.
/// Returns nullopt for an empty path. With a key, this process's memory becomes private
/// (core/base/this_process.h).
/// @throw Failure(bad_usage) naming the path, never its content. Causes: not a readable regular
/// file, a wrong length, readable by others than its owner, or only zeros. An empty path also
/// throws while the variable TACHLESS_KEY_FILE is set to an empty text.
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
  /// Writes the digest of `size` bytes. No bytes can be added afterwards.
  void finish(std::span<unsigned char> digest);
  /// Returns the first 64 bits of the digest in network order: the same number on every host.
  [[nodiscard]] std::int64_t value() const;

 private:
  // Storage of crypto_generichash_state.
  alignas(64) std::array<unsigned char, 384> state_{};
  std::size_t size_;
};

}  // namespace tachless::bus
