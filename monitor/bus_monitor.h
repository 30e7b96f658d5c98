#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "bus/udp_transport.h"
#include "monitor/message_reader.h"
#include "monitor/sequence_gaps.h"

namespace tachless::monitor {

/// What `tachless watch` knows of a bus: counts of everything heard, per channel and per sender.
/// Datagrams go in, a table or JSON comes out; neither receives nor prints. Memory is bounded,
/// whatever is on the bus.
class BusMonitor {
 public:
  static constexpr std::size_t max_channels = 500;
  static constexpr std::size_t max_senders = 200;

  void take(const bus::Datagram& datagram);

  /// What the transport itself has lost or passed over, as of now.
  void set_statistics(const bus::BusStatistics& statistics) { transport_ = statistics; }

  /// Ends the stretch of time over which rate, jitter and bandwidth are taken, and begins a new
  /// one.
  /// @param seconds length of the stretch that ends, > 0
  void end_stretch(double seconds);

  /// For people: one row per channel, then the newest values. At most `rows` lines of at most
  /// `columns` characters; 0: no limit. What does not fit is said to be left out.
  [[nodiscard]] std::vector<std::string> table(std::size_t columns = 0, std::size_t rows = 0);

  /// For programs.
  [[nodiscard]] nlohmann::ordered_json to_json();

  [[nodiscard]] std::uint64_t messages() const { return messages_; }
  /// Messages of our types that could not be decoded, and messages of another type on a channel
  /// that carries one of ours.
  [[nodiscard]] std::uint64_t undecodable() const;

 private:
  /// Arrivals within one stretch of time.
  struct Arrivals {
    std::uint64_t messages = 0;
    std::uint64_t bytes = 0;
    std::uint64_t intervals = 0;
    double mean_ns = 0, deviations_ns2 = 0;  ///< of the intervals, after Welford
    std::int64_t longest_ns = 0;

    void add(std::int64_t interval_ns);
    [[nodiscard]] std::optional<double> rate_hz() const;
    [[nodiscard]] std::optional<double> jitter_s() const;
  };
  struct Channel {
    std::string_view type;  ///< newest of ours; empty: none yet
    std::uint64_t messages = 0, bytes = 0;
    std::uint64_t tagged = 0;    ///< messages with the tag of a key
    std::uint64_t not_ours = 0;  ///< messages of unknown types
    std::map<bus::Rejection, std::uint64_t> rejected;
    bool once_per_tick = false;
    std::int64_t run = 0;
    SequenceGaps ticks;
    std::optional<std::int64_t> last_ns;
    Arrivals now, shown;
    double shown_seconds = 0;
    loop::Stamp newest_stamp;
    std::vector<std::byte> newest;  ///< that could be decoded

    [[nodiscard]] std::uint64_t undecodable() const;
  };
  struct Sender {
    std::uint64_t messages = 0;
    SequenceGaps sequence;
  };

  void note_sender(std::string_view sender, std::uint32_t sequence);
  void note_channel(const bus::Datagram& datagram);
  [[nodiscard]] std::vector<std::string> head_lines() const;
  [[nodiscard]] std::vector<std::string> channel_lines(std::size_t columns) const;
  [[nodiscard]] std::vector<std::string> value_lines();

  MessageReader reader_;
  std::map<std::string, Channel, std::less<>> channels_;
  std::map<std::string, Sender, std::less<>> senders_;
  std::uint64_t messages_ = 0, bytes_ = 0;
  std::uint64_t elsewhere_ = 0;      ///< messages on channels beyond `max_channels`
  std::uint64_t other_senders_ = 0;  ///< messages of senders beyond `max_senders`
  double seconds_ = 0;
  bus::BusStatistics transport_;
};

}  // namespace tachless::monitor
