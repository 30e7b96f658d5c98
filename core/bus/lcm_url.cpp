#include "bus/lcm_url.h"

#include <arpa/inet.h>
#include <fmt/core.h>

#include <charconv>
#include <cstdlib>
#include <stdexcept>
#include <string_view>

namespace tachless::bus {
namespace {

constexpr std::string_view provider = "udpm://";

// The functions throw std::invalid_argument for a wrong part; `parse_lcm_url` adds the whole URL.

int number(std::string_view key, std::string_view text, int lowest, int highest) {
  int value = 0;
  const char* const end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data(), end, value);
  if (error == std::errc() && stop == end && value >= lowest && value <= highest) return value;
  throw std::invalid_argument(
      fmt::format("{} is '{}', allowed are {} to {}", key, text, lowest, highest));
}

std::uint16_t port(std::string_view text) {
  return static_cast<std::uint16_t>(number("port", text, 1, 65'535));
}

/// Returns the text before the first `separator`; `rest` keeps the text after it.
std::string_view take(std::string_view& rest, char separator) {
  const std::size_t at = rest.find(separator);
  const std::string_view head = rest.substr(0, at);
  rest = at == std::string_view::npos ? std::string_view() : rest.substr(at + 1);
  return head;
}

LcmUrl options_of(std::string_view options) {
  LcmUrl result;
  std::string_view network = take(options, '?');
  const bool has_port = network.find(':') != std::string_view::npos;
  const std::string_view group = take(network, ':');
  if (!group.empty()) result.group = group;
  in_addr address{};
  if (inet_pton(AF_INET, result.group.c_str(), &address) != 1 ||
      !IN_MULTICAST(ntohl(address.s_addr))) {
    throw std::invalid_argument(
        fmt::format("'{}' is not an IPv4 multicast address, 224.0.0.0 to 239.255.255.255", group));
  }
  if (has_port) result.port = port(network);
  while (!options.empty()) {
    std::string_view value = take(options, '&');
    const std::string_view key = take(value, '=');
    if (key == "ttl") {
      result.ttl = number(key, value, 0, 255);
    } else if (key == "recv_buf_size") {
      result.receive_buffer_bytes = number(key, value, 1, 1'000'000'000);
    } else {
      throw std::invalid_argument(
          fmt::format("unknown option '{}', allowed are ttl and recv_buf_size", key));
    }
  }
  return result;
}

}  // namespace

std::string LcmUrl::text() const {
  const std::string buffer =
      receive_buffer_bytes == 0 ? "" : fmt::format("&recv_buf_size={}", receive_buffer_bytes);
  return fmt::format("{}{}:{}?ttl={}{}", provider, group, port, ttl, buffer);
}

LcmUrl parse_lcm_url(const std::string& text) {
  const char* environment = std::getenv("LCM_DEFAULT_URL");
  std::string_view url = text;
  if (text.empty() && environment != nullptr) url = environment;
  if (url.empty()) return {};
  try {
    if (url.starts_with(provider)) return options_of(url.substr(provider.size()));
    throw std::invalid_argument(
        "the bus needs LCM's provider udpm, as in udpm://239.255.76.67:7667?ttl=0; without "
        "multicast use run --isolate or --in-process");
  } catch (const std::invalid_argument& why) {
    throw std::invalid_argument(fmt::format("LCM URL '{}': {}", url, why.what()));
  }
}

}  // namespace tachless::bus
