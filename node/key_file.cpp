#include "node/key_file.h"

#include <fcntl.h>
#include <fmt/core.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <iterator>
#include <stdexcept>
#include <string>

#include "diagnostics/failure.h"
#include "process/file_descriptor.h"
#include "process/this_process.h"

namespace tachless::node {
namespace {

constexpr std::size_t hex_size = 2 * bus::Key::size;

int digit(unsigned char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  if (c >= 'A' && c <= 'F') return c - 'A' + 10;
  return -1;
}

/// What was read of the file, overwritten with zeros on destruction.
struct Content {
  Content() = default;
  Content(const Content&) = delete;
  Content& operator=(const Content&) = delete;
  ~Content() { explicit_bzero(bytes.data(), bytes.size()); }
  std::array<unsigned char, hex_size + 3> bytes{};  // more than any valid file holds
};

/// The key in the first `size` bytes of a file.
/// @throw std::invalid_argument in words, without the content
bus::Key decoded(const Content& content, std::size_t size) {
  bus::Key key;
  if (size == bus::Key::size) {
    std::copy_n(content.bytes.begin(), size, key.bytes().begin());
    return key;
  }
  std::size_t digits = size;
  while (digits > 0 && (content.bytes[digits - 1] == '\n' || content.bytes[digits - 1] == '\r')) {
    --digits;
  }
  if (digits != hex_size) throw std::invalid_argument("a key is 32 bytes or 64 hexadecimal digits");
  for (std::size_t i = 0; i < bus::Key::size; ++i) {
    const int high = digit(content.bytes[2 * i]);
    const int low = digit(content.bytes[2 * i + 1]);
    if (high < 0 || low < 0) {
      throw std::invalid_argument(fmt::format(
          "character {} is no hexadecimal digit; a key is 32 bytes or 64 hexadecimal digits",
          2 * i + (high < 0 ? 1 : 2)));
    }
    key.bytes()[i] = static_cast<unsigned char>(high << 4 | low);
  }
  return key;
}

}  // namespace

bus::Key read_key_file(const std::filesystem::path& path) {
  const auto refuse = [&](const std::string& problem) {
    return diagnostics::bad_usage("--key-file: {}: {}", path.string(), problem);
  };
  const std::string make =
      fmt::format("make one: (umask 077; head -c 32 /dev/urandom > {})", path.string());
  const process::FileDescriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
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
  const ssize_t got = ::read(file.get(), content.bytes.data(), content.bytes.size());
  if (got < 0) throw refuse(fmt::format("cannot be read: {}", std::strerror(errno)));
  process::make_memory_private();
  const bus::Key key = [&] {
    try {
      return decoded(content, static_cast<std::size_t>(got));
    } catch (const std::invalid_argument& problem) {
      throw refuse(fmt::format("holds {} bytes: {}; {}", status.st_size, problem.what(), make));
    }
  }();
  if (std::ranges::count(key.bytes(), 0) == std::ssize(key.bytes())) {
    throw refuse("is all zeros, which anybody can guess; " + make);
  }
  return key;
}

}  // namespace tachless::node
