#include "process/display.h"

#include <netdb.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/un.h>

#include <charconv>
#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <string_view>

#include "process/file_descriptor.h"

namespace tachless::process {
namespace {

constexpr const char* remedy = "; sit at a desktop or log in with ssh -X";

bool connects(int family, const sockaddr* address, socklen_t size) {
  const FileDescriptor fd(::socket(family, SOCK_STREAM | SOCK_CLOEXEC, 0));
  const timeval patience{3, 0};
  setsockopt(fd.get(), SOL_SOCKET, SO_SNDTIMEO, &patience, sizeof patience);
  return ::connect(fd.get(), address, size) == 0;
}

bool local_server_answers(int number) {
  const std::string path = "/tmp/.X11-unix/X" + std::to_string(number);
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::memcpy(address.sun_path, path.c_str(), path.size() + 1);
  const auto* generic = reinterpret_cast<const sockaddr*>(&address);
  if (connects(AF_UNIX, generic, sizeof address)) return true;
  // The same name without a file, which begins with a NUL.
  std::memcpy(address.sun_path + 1, path.c_str(), path.size());
  address.sun_path[0] = '\0';
  return connects(AF_UNIX, generic,
                  static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + 1 + path.size()));
}

bool remote_server_answers(const std::string& host, int number) {
  addrinfo hints{};
  hints.ai_socktype = SOCK_STREAM;
  addrinfo* found = nullptr;
  const std::string port = std::to_string(6000 + number);
  if (getaddrinfo(host.c_str(), port.c_str(), &hints, &found) != 0) return false;
  const std::unique_ptr<addrinfo, void (*)(addrinfo*)> owner(found, freeaddrinfo);
  for (const addrinfo* at = found; at != nullptr; at = at->ai_next) {
    if (connects(at->ai_family, at->ai_addr, at->ai_addrlen)) return true;
  }
  return false;
}

}  // namespace

std::optional<std::string> display_problem() {
  const char* variable = std::getenv("DISPLAY");
  const std::string_view display = variable == nullptr ? "" : variable;
  if (display.empty()) return std::string("no display: DISPLAY is not set") + remedy;
  // [HOST]:NUMBER[.SCREEN]
  const std::string quoted = "DISPLAY=" + std::string(display);
  const std::size_t colon = display.rfind(':');
  const std::string_view rest = colon == std::string_view::npos ? "" : display.substr(colon + 1);
  int number = -1;
  const char* const end = rest.data() + rest.size();
  const char* const after = std::from_chars(rest.data(), end, number).ptr;
  if (number < 0 || number > 59535 || (after != end && *after != '.')) {  // TCP ports end at 65535
    return "no display: " + quoted + " names none" + remedy;
  }
  const std::string host(display.substr(0, colon));
  const bool local = host.empty() || host == "unix";
  if (local ? local_server_answers(number) : remote_server_answers(host, number)) return {};
  return "no display: no X server answers at " + quoted + remedy;
}

}  // namespace tachless::process
