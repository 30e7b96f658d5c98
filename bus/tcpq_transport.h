#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <string>
#include <string_view>
#include <vector>

#include "bus/lcm_url.h"
#include "bus/transport.h"
#include "process/file_descriptor.h"

namespace tachless::bus {

/// LCM's provider tcpq: every message goes to a server over TCP, and from it to whoever has
/// subscribed. For networks without multicast. Nothing is lost or reordered while the connection
/// lasts; where it ends, `receive` and `publish` throw. The server sends a program its own messages
/// too; these are passed over, one for each that was sent. Interoperates with liblcm's tcpq and its
/// Java server. One transport serves one thread.
class TcpqTransport final : public MonitoredBus {
 public:
  /// @throw std::system_error naming the server, within `patience`
  explicit TcpqTransport(const LcmUrl& url);

  /// @throw std::invalid_argument unless the name has 1 to 63 characters, all of them letters,
  /// digits or '_': the server takes it for a regular expression
  void subscribe(const std::string& channel) override;
  void subscribe_all() override;

  /// Waits while the connection is full, at most `patience`.
  /// @throw diagnostics::Failure(peer_lost) when the connection is gone, (protocol_violated) when
  /// the server does not send back what this program hears too
  void publish(std::string_view channel, std::span<const std::byte> payload) override;

  /// `Datagram::sender` is the server: who has sent it the server does not say.
  /// @throw diagnostics::Failure(peer_lost) when the connection is gone, (protocol_violated) when
  /// what comes is no LCM. Too long messages are passed over.
  std::optional<Datagram> receive(loop::Clock::time_point deadline) override;

  [[nodiscard]] BusStatistics statistics() const override { return statistics_; }
  [[nodiscard]] int receive_buffer_bytes() const override;

 private:
  static constexpr std::chrono::seconds patience{5};
  // Anything longer could be on no other bus, and is passed over.
  static constexpr std::size_t longest_channel = 63, longest_message = 65'498;
  // Of a server that sends them back, a few are on their way.
  static constexpr std::size_t most_sent = 10'000;

  void send(std::uint32_t type, std::string_view channel,
            const std::span<const std::byte>* payload);
  /// The next message that is all there.
  bool parse(Datagram& message);
  /// Whether bytes came before the deadline.
  bool read(loop::Clock::time_point deadline);
  bool is_own(const Datagram& message);
  [[noreturn]] void lose(const std::string& why) const;

  std::string name_;  ///< "tcpq://10.0.0.1:7700"
  process::FileDescriptor socket_;
  std::vector<std::string> channels_;  ///< subscribed
  bool all_ = false;
  struct Sent {
    std::string channel;
    std::vector<std::byte> payload;
  };
  std::deque<Sent> sent_;       ///< that will come back
  std::vector<std::byte> out_;  ///< what is sent, whole
  std::vector<std::byte> buffer_;
  std::size_t begin_ = 0, end_ = 0;  ///< of what was read and not handed out
  std::size_t skip_ = 0;             ///< bytes to come that are passed over
  BusStatistics statistics_;
};

/// What starts the server that the URL names, where it may be started.
std::string server_command(const LcmUrl& url);

}  // namespace tachless::bus
