#include "bus/key.h"

#include <fcntl.h>
#include <fmt/core.h>
#include <sodium.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cctype>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <new>
#include <stdexcept>
#include <string>

#include "base/failure.h"
#include "base/file_descriptor.h"
#include "base/text.h"
#include "base/this_process.h"

namespace tachless::bus {
namespace {

constexpr std::size_t hex_size = 2 * Key::size;

/// Initialises libsodium; required before any other use of the library.
void require_sodium() {
  if (sodium_init() < 0) throw std::runtime_error("libsodium cannot be used on this machine");
}

/// Content of a key file, overwritten with zeros on destruction.
struct Content {
  Content() = default;
  Content(const Content&) = delete;
  Content& operator=(const Content&) = delete;
  ~Content() { sodium_memzero(text.data(), text.size()); }
  std::array<char, hex_size + 3> text{};  // longer than any valid file
};

/// Returns the key in the first `size` bytes of a file.
/// @throw std::invalid_argument in words, without the content
Key decoded(const Content& content, std::size_t size) {
  Key key;
  if (size == content.text.size()) throw std::invalid_argument("that is longer than a key");
  if (size == Key::size) {
    std::memcpy(key.bytes().data(), content.text.data(), size);
    return key;
  }
  const auto is_line_end = [](char c) { return c == '\n' || c == '\r'; };
  while (size > 0 && is_line_end(content.text[size - 1])) --size;
  if (size != hex_size) throw std::invalid_argument("a key is 32 bytes or 64 hexadecimal digits");
  for (std::size_t i = 0; i < size; ++i) {
    if (std::isxdigit(static_cast<unsigned char>(content.text[i])) != 0) continue;
    throw std::invalid_argument(fmt::format(
        "character {} is no hexadecimal digit; a key is 32 bytes or 64 hexadecimal digits", i + 1));
  }
  sodium_hex2bin(key.bytes().data(), Key::size, content.text.data(), size, nullptr, nullptr,
                 nullptr);
  return key;
}

crypto_generichash_state* in(unsigned char* bytes) {
  return reinterpret_cast<crypto_generichash_state*>(bytes);
}

}  // namespace

Key::Key() {
  require_sodium();
  bytes_ = {static_cast<unsigned char*>(sodium_malloc(size)), &sodium_free};
  if (bytes_ == nullptr) throw std::bad_alloc();
  sodium_memzero(bytes_.get(), size);
}

std::optional<Key> read_key_file(const std::filesystem::path& path) {
  if (path.empty()) {
    // A set but empty variable must not silently mean "without a key".
    if (const char* variable = std::getenv("TACHLESS_KEY_FILE")) {
      if (*variable == '\0') {
        throw base::bad_usage(
            "TACHLESS_KEY_FILE is set but empty; name the key's file, or unset it");
      }
    }
    return std::nullopt;
  }
  const auto refuse = [&](const std::string& problem) {
    return base::bad_usage("--key-file: {}: {}", path.string(), problem);
  };
  const std::string make = fmt::format("make one: (umask 077; head -c 32 /dev/urandom > {})",
                                       base::shell_word(path.string()));
  const base::FileDescriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  if (file.get() < 0) {
    const int error = errno;
    throw refuse(fmt::format("cannot be read: {}{}", std::strerror(error),
                             error == ENOENT ? "; " + make : ""));
  }
  struct stat status {};
  if (::fstat(file.get(), &status) != 0 || !S_ISREG(status.st_mode)) {
    throw refuse("not a regular file; " + make);
  }
  if ((status.st_mode & 077) != 0) {
    throw refuse(
        fmt::format("its mode is {:04o}, others than its owner may use it; type: chmod 600 {}",
                    status.st_mode & 07777U, path.string()));
  }
  Content content;
  const ssize_t got = ::read(file.get(), content.text.data(), content.text.size());
  if (got < 0) throw refuse(fmt::format("cannot be read: {}", std::strerror(errno)));
  base::make_memory_private();
  Key key = [&] {
    try {
      return decoded(content, static_cast<std::size_t>(got));
    } catch (const std::invalid_argument& problem) {
      throw refuse(fmt::format("holds {} bytes: {}; {}", status.st_size, problem.what(), make));
    }
  }();
  if (sodium_is_zero(key.bytes().data(), Key::size) != 0) {
    throw refuse("is all zeros, which anybody can guess; " + make);
  }
  return key;
}

std::int64_t random_number() {
  require_sodium();
  std::uint64_t number = 0;
  randombytes_buf(&number, sizeof number);
  return static_cast<std::int64_t>(number >> 1 | 1);
}

Digest::Digest(std::size_t size, const Key* key) : size_(size) {
  static_assert(sizeof(state_) == sizeof(crypto_generichash_state));
  if (key == nullptr) require_sodium();  // Key's constructor has already called it
  crypto_generichash_init(in(state_.data()), key == nullptr ? nullptr : key->bytes().data(),
                          key == nullptr ? 0 : Key::size, size);
}

Digest::~Digest() { sodium_memzero(state_.data(), state_.size()); }

void Digest::add(std::span<const std::byte> bytes) {
  crypto_generichash_update(in(state_.data()), reinterpret_cast<const unsigned char*>(bytes.data()),
                            bytes.size());
}

void Digest::finish(std::span<unsigned char> digest) {
  if (digest.size() != size_) throw std::logic_error("a digest of another size was asked for");
  crypto_generichash_final(in(state_.data()), digest.data(), size_);
}

std::int64_t Digest::value() const {
  Digest copy = *this;
  std::array<unsigned char, 64> whole{};
  copy.finish(std::span(whole).first(size_));
  std::uint64_t result = 0;
  for (std::size_t i = 0; i < sizeof result; ++i) result = result << 8 | whole[i];
  return static_cast<std::int64_t>(result);
}

}  // namespace tachless::bus
