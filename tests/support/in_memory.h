#pragma once

#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <random>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "bus/subscriptions.h"
#include "bus/transport.h"

namespace tachless::bus {

/// What a network does to messages, each copy to each receiver on its own.
struct NetworkFaults {
  double loss = 0;         ///< probability
  double duplication = 0;  ///< probability that a message comes twice
  double reordering = 0;   ///< probability that up to `overtaken_by` later messages come first
  int overtaken_by = 3;
  std::uint64_t seed = 1;
};

/// A bus inside one process, for tests: endpoints may be used from different threads, each
/// endpoint from one at a time. Outlives its endpoints.
class InMemoryNetwork {
 public:
  /// Messages that wait for a receiver; what comes beyond is lost to it, as at a full socket.
  /// Without a bound, a receiver flooded faster than it reads would fall behind for ever.
  static constexpr std::size_t receive_buffer = 2048;

  explicit InMemoryNetwork(const NetworkFaults& faults = {});
  InMemoryNetwork(const InMemoryNetwork&) = delete;
  InMemoryNetwork& operator=(const InMemoryNetwork&) = delete;
  ~InMemoryNetwork();

  /// A new participant; receivers see `name` as the sender of its messages.
  std::unique_ptr<Transport> connect(std::string name);

  /// Messages that this participant has lost because its receive buffer was full.
  std::int64_t num_overflowed(const std::string& name);

 private:
  struct Message {
    std::string channel;
    std::vector<std::byte> payload;
    std::string sender;
    int held_back = 0;  ///< messages that still overtake it
  };
  struct Mailbox {
    std::condition_variable arrived;
    Subscriptions channels;
    std::deque<Message> queue;
    std::vector<Message> held;
  };
  class Endpoint;

  void deliver(const Endpoint* from, std::string_view sender, std::string_view channel,
               std::span<const std::byte> payload);
  void put(Endpoint& to, Message message);

  std::mutex mutex_;
  NetworkFaults faults_;
  std::mt19937_64 random_;
  std::vector<Endpoint*> endpoints_;
  std::map<std::string, std::int64_t> num_overflowed_;
};

}  // namespace tachless::bus
