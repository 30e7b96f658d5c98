#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "bus/udp_transport.h"
#include "live/arrivals.h"
#include "live/sequence_gaps.h"
#include "messages/truth/tick_record.h"
#include "messages/truth/truth_wire.h"

namespace tachless::live {

/// One field of a message, named as in its .lcm file.
struct MessageField {
  std::string name;       ///< name; for a law's signals with the row: "value[0]"
  std::string_view unit;  ///< unit for revolute joints; empty: no unit
  nlohmann::ordered_json value;
};

/// Facts about a message that are known without its run.
struct Glance {
  std::string_view type;  ///< "tachless.tick_t"; empty: unknown type, and nothing else is known
  messages::Rejection rejection = messages::Rejection::none;
  messages::Stamp stamp;       ///< stamp, if the message is not rejected
  bool tagged = false;         ///< has a tag of a key, which is not verified
  bool once_per_tick = false;  ///< the type is sent for every tick of a run
};

/// Reads a message of any tachless type without knowing the run. The message states its numbers of
/// joints, motors and signals. These numbers are accepted only if the message has exactly the
/// resulting size and passes every other check of the wire format. A tag at the end
/// (core/bus/authenticated.h) is noticed. The tag is not verified, because verification needs the
/// key.
/// @param fields if not null, gets all fields after utime, run and tick, unless rejected
Glance glance(std::span<const std::byte> message, std::vector<MessageField>* fields = nullptr);

/// Counts of everything received on a bus, per channel and per sender. The class neither receives
/// nor prints. Its memory is bounded for any traffic.
class BusMonitor {
 public:
  static constexpr std::size_t max_channels = 500;
  static constexpr std::size_t max_senders = 200;

  /// Counts a received datagram.
  void take(const bus::Datagram& datagram);

  /// Sets the counts of messages that the transport has lost or skipped so far.
  void set_statistics(const bus::BusStatistics& statistics) { transport_ = statistics; }

  /// Ends the interval of rate, jitter and bandwidth, and begins a new one.
  /// @param seconds its length, > 0
  void end_interval(double seconds);

  /// Returns one row per channel, then the newest values, for people. It has at most `rows` lines;
  /// 0: no limit. The last line counts what does not fit.
  [[nodiscard]] std::vector<std::string> table(std::size_t rows = 0) const;

  /// Returns the counts, for programs. `undecodable` counts messages of tachless types that could
  /// not be decoded, and messages of another type on a channel that carries a tachless type.
  [[nodiscard]] nlohmann::ordered_json to_json() const;

 private:
  /// Messages within one interval of time.
  struct Traffic {
    std::uint64_t bytes = 0;
    Arrivals arrivals;
    double seconds = 0;  ///< length of the interval, once it has ended

    [[nodiscard]] std::optional<double> bytes_per_s() const {
      if (!(seconds > 0)) return std::nullopt;
      return static_cast<double>(bytes) / seconds;
    }
  };
  struct Channel {
    std::string_view type;  ///< newest tachless type; empty: none yet
    std::uint64_t messages = 0, bytes = 0;
    std::uint64_t tagged = 0;    ///< messages with the tag of a key
    std::uint64_t not_ours = 0;  ///< messages of unknown types
    std::map<messages::Rejection, std::uint64_t> rejected;
    bool once_per_tick = false;
    std::int64_t run = 0;
    SequenceGaps ticks;
    std::optional<std::int64_t> last_ns;
    Traffic now, shown;
    messages::Stamp newest_stamp;
    std::vector<std::byte> newest;  ///< message that could be decoded

    /// Returns the number of messages of tachless types that could not be decoded. Messages of
    /// another type on a channel that carries a tachless type count too.
    [[nodiscard]] std::uint64_t undecodable() const;
  };
  struct Sender {
    std::uint64_t messages = 0;
    SequenceGaps sequence;
  };

  void note_sender(std::string_view sender, std::uint32_t sequence);
  void note_channel(const bus::Datagram& datagram);
  [[nodiscard]] std::uint64_t undecodable() const;
  [[nodiscard]] static nlohmann::ordered_json json_of(const std::string& name,
                                                      const Channel& channel);

  std::map<std::string, Channel, std::less<>> channels_;
  std::map<std::string, Sender, std::less<>> senders_;
  std::uint64_t messages_ = 0, bytes_ = 0;
  std::uint64_t elsewhere_ = 0;      ///< messages on channels beyond `max_channels`
  std::uint64_t other_senders_ = 0;  ///< messages of senders beyond `max_senders`
  double seconds_ = 0;
  bus::BusStatistics transport_;
};

}  // namespace tachless::live
