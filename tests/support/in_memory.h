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

/// Faults of a network, drawn for each copy of a message to each receiver.
struct NetworkFaults {
  double loss = 0;         ///< probability
  double duplication = 0;  ///< probability that a message arrives twice
  double reordering = 0;   ///< probability that up to `overtaken_by` later messages come first
  int overtaken_by = 3;
  std::uint64_t seed = 1;
};

/// A bus inside one process, for tests. Different threads may use different endpoints; only one
/// thread at a time may use an endpoint. The network must outlive its endpoints.
class InMemoryNetwork {
 public:
  /// Greatest number of waiting messages of a receiver; further ones are dropped, as at a full
  /// socket. Without a bound, a flooded receiver would fall ever further behind.
  static constexpr std::size_t receive_buffer = 2048;

  explicit InMemoryNetwork(const NetworkFaults& faults = {});
  InMemoryNetwork(const InMemoryNetwork&) = delete;
  InMemoryNetwork& operator=(const InMemoryNetwork&) = delete;
  ~InMemoryNetwork();

  /// Adds a participant; receivers see `name` as the sender of its messages.
  std::unique_ptr<Transport> connect(std::string name);

  /// Returns the number of messages that this participant lost because its receive buffer was full.
  std::int64_t num_overflowed(const std::string& name);

 private:
  struct Message {
    std::string channel;
    std::vector<std::byte> payload;
    std::string sender;
    int held_back = 0;  ///< number of messages that still overtake it
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
