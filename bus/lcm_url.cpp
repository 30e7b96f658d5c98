#include "bus/lcm_url.h"

#include <arpa/inet.h>

#include <charconv>
#include <cstdlib>
#include <optional>
#include <stdexcept>
#include <string_view>

namespace tachless::bus {
namespace {

constexpr std::string_view provider = "udpm://", tcp_provider = "tcpq://";

std::optional<long> integer(std::string_view text) {
  long value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return value;
}

/// Everything before the first `separator`; `rest` keeps what comes after it.
std::string_view take(std::string_view& rest, char separator) {
  const std::size_t at = rest.find(separator);
  const std::string_view head = rest.substr(0, at);
  rest = at == std::string_view::npos ? std::string_view() : rest.substr(at + 1);
  return head;
}

/// Reads one URL; every refusal quotes it whole.
class Reader {
 public:
  explicit Reader(const std::string& url) : url_(url) {}

  [[nodiscard]] LcmUrl read() const {
    if (url_.rfind(tcp_provider, 0) == 0) return tcp();
    if (url_.rfind(provider, 0) != 0) {
      refuse(
          "the bus needs LCM's provider udpm or tcpq, as in udpm://239.255.76.67:7667?ttl=0 or "
          "tcpq://127.0.0.1:7700");
    }
    LcmUrl result;
    std::string_view options = std::string_view(url_).substr(provider.size());
    std::string_view network = take(options, '?');
    const bool has_port = network.find(':') != std::string_view::npos;
    const std::string group(take(network, ':'));
    if (!group.empty()) result.group = group;
    in_addr address{};
    if (inet_pton(AF_INET, result.group.c_str(), &address) != 1 ||
        !IN_MULTICAST(ntohl(address.s_addr))) {
      refuse("'" + result.group + "' is not an IPv4 multicast address, 224.0.0.0 to " +
             "239.255.255.255");
    }
    if (has_port) result.port = static_cast<std::uint16_t>(number("port", network, 1, 65'535));
    while (!options.empty()) {
      std::string_view value = take(options, '&');
      const std::string key(take(value, '='));
      if (key == "ttl") {
        result.ttl = static_cast<int>(number("ttl", value, 0, 255));
      } else if (key == "recv_buf_size") {
        result.receive_buffer_bytes =
            static_cast<int>(number("recv_buf_size", value, 1, 1'000'000'000));
      } else {
        refuse("unknown option '" + key + "', allowed are ttl and recv_buf_size");
      }
    }
    return result;
  }

 private:
  [[nodiscard]] LcmUrl tcp() const {
    std::string_view port = std::string_view(url_).substr(tcp_provider.size());
    if (port.find('?') != std::string_view::npos) refuse("tcpq has no options");
    const bool has_port = port.find(':') != std::string_view::npos;
    LcmUrl result;
    result.server = take(port, ':');
    if (result.server.empty()) result.server = "127.0.0.1";
    result.port = has_port ? static_cast<std::uint16_t>(number("port", port, 1, 65'535)) : 7700;
    return result;
  }

  [[noreturn]] void refuse(const std::string& why) const {
    throw std::invalid_argument("LCM URL '" + url_ + "': " + why);
  }

  [[nodiscard]] long number(const char* key, std::string_view text, long lowest,
                            long highest) const {
    const std::optional<long> value = integer(text);
    if (!value || *value < lowest || *value > highest) {
      refuse(std::string(key) + " is '" + std::string(text) + "', allowed are " +
             std::to_string(lowest) + " to " + std::to_string(highest));
    }
    return *value;
  }

  const std::string& url_;
};

}  // namespace

std::string LcmUrl::text() const {
  if (is_tcp()) return std::string(tcp_provider) + server + ":" + std::to_string(port);
  return std::string(provider) + group + ":" + std::to_string(port) +
         "?ttl=" + std::to_string(ttl) +
         (receive_buffer_bytes == 0 ? ""
                                    : "&recv_buf_size=" + std::to_string(receive_buffer_bytes));
}

LcmUrl parse_lcm_url(const std::string& text) {
  if (!text.empty()) return Reader(text).read();
  const char* environment = std::getenv("LCM_DEFAULT_URL");
  if (environment == nullptr || *environment == '\0') return {};
  const std::string url = environment;
  return Reader(url).read();
}

}  // namespace tachless::bus
