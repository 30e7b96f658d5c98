#include "node/key_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <string>

#include "diagnostics/failure.h"
#include "process/file_descriptor.h"

namespace tachless::node {
namespace {

constexpr std::size_t hex_size = 2 * bus::Key::size;

int digit(unsigned char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  if (c >= 'A' && c <= 'F') return c - 'A' + 10;
  return -1;
}

/// What was read of the file, wiped when it goes.
struct Content {
  Content() = default;
  Content(const Content&) = delete;
  Content& operator=(const Content&) = delete;
  ~Content() { explicit_bzero(bytes.data(), bytes.size()); }
  std::array<unsigned char, hex_size + 3> bytes{};  // more than any valid file holds
};

}  // namespace

bus::Key read_key_file(const std::filesystem::path& path) {
  const auto refuse = [&](const std::string& problem) {
    return diagnostics::Failure(diagnostics::ExitCode::bad_usage,
                                "--key-file: " + path.string() + ": " + problem);
  };
  const std::string make = "make one: (umask 077; head -c 32 /dev/urandom > " + path.string() + ")";
  const process::FileDescriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  if (file.get() < 0) {
    const int error = errno;
    throw refuse(std::string("cannot be read: ") + std::strerror(error) +
                 (error == ENOENT ? "; " + make : ""));
  }
  struct stat status {};
  if (::fstat(file.get(), &status) != 0 || !S_ISREG(status.st_mode)) {
    throw refuse("not a regular file; " + make);
  }
  if ((status.st_mode & 077) != 0) {
    std::array<char, 8> mode{};
    std::snprintf(mode.data(), mode.size(), "%04o", status.st_mode & 07777U);
    throw refuse(std::string("its mode is ") + mode.data() +
                 ", others than its owner may use it; type: chmod 600 " + path.string());
  }
  Content content;
  const ssize_t got = ::read(file.get(), content.bytes.data(), content.bytes.size());
  if (got < 0) throw refuse(std::string("cannot be read: ") + std::strerror(errno));
  auto size = static_cast<std::size_t>(got);
  bus::Key key;
  if (size == bus::Key::size) {
    std::copy_n(content.bytes.begin(), size, key.bytes.begin());
    return key;
  }
  while (size > 0 && (content.bytes[size - 1] == '\n' || content.bytes[size - 1] == '\r')) --size;
  if (size != hex_size) {
    throw refuse("holds " + std::to_string(status.st_size) +
                 " bytes; a key is 32 bytes or 64 hexadecimal digits; " + make);
  }
  for (std::size_t i = 0; i < bus::Key::size; ++i) {
    const int high = digit(content.bytes[2 * i]);
    const int low = digit(content.bytes[2 * i + 1]);
    if (high < 0 || low < 0) {
      throw refuse("character " + std::to_string(2 * i + (high < 0 ? 1 : 2)) +
                   " is no hexadecimal digit; a key is 32 bytes or 64 hexadecimal digits");
    }
    key.bytes[i] = static_cast<unsigned char>(high << 4 | low);
  }
  return key;
}

}  // namespace tachless::node
