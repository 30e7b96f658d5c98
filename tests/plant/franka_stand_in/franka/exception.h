#pragma once

// Names of libfranka's franka/exception.h that the driver uses.

#include <cstdint>
#include <stdexcept>
#include <string>

namespace franka {

struct Exception : std::runtime_error {
  using std::runtime_error::runtime_error;
};
struct NetworkException : Exception {
  using Exception::Exception;
};
struct CommandException : Exception {
  using Exception::Exception;
};
struct ControlException : Exception {
  using Exception::Exception;
};
struct IncompatibleVersionException : Exception {
  IncompatibleVersionException(std::uint16_t server, std::uint16_t library)
      : Exception("incompatible version"), server_version(server), library_version(library) {}
  const std::uint16_t server_version, library_version;
};

}  // namespace franka
