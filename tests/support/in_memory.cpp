#include "tests/support/in_memory.h"

#include <algorithm>
#include <optional>
#include <utility>

namespace tachless::bus {

class InMemoryNetwork::Endpoint : public Transport {
 public:
  Endpoint(InMemoryNetwork& network, std::string name)
      : network_(network), name_(std::move(name)) {}

  ~Endpoint() override {
    const std::lock_guard lock(network_.mutex_);
    std::erase(network_.endpoints_, this);
  }

  int subscribe(const std::string& channel) override {
    const std::lock_guard lock(network_.mutex_);
    return mailbox_.channels.add(channel);
  }

  void publish(std::string_view channel, std::span<const std::byte> payload) override {
    network_.deliver(this, name_, channel, payload);
  }

  std::optional<Datagram> receive(base::Clock::time_point deadline) override {
    std::unique_lock lock(network_.mutex_);
    const auto there = [this] { return !mailbox_.queue.empty(); };
    if (!mailbox_.arrived.wait_until(lock, deadline, there)) {
      // No later message will overtake them.
      std::ranges::move(mailbox_.held, std::back_inserter(mailbox_.queue));
      mailbox_.held.clear();
      if (mailbox_.queue.empty()) return std::nullopt;
    }
    current_ = std::move(mailbox_.queue.front());
    mailbox_.queue.pop_front();
    return Datagram{.channel = current_.channel,
                    .payload = current_.payload,
                    .sender = current_.sender,
                    .channel_number = mailbox_.channels.find(current_.channel)};
  }

 private:
  friend class InMemoryNetwork;

  InMemoryNetwork& network_;
  std::string name_;
  Mailbox mailbox_;
  Message current_;
};

InMemoryNetwork::InMemoryNetwork(const NetworkFaults& faults)
    : faults_(faults), random_(faults.seed) {}

InMemoryNetwork::~InMemoryNetwork() = default;

std::unique_ptr<Transport> InMemoryNetwork::connect(std::string name) {
  auto endpoint = std::make_unique<Endpoint>(*this, std::move(name));
  const std::lock_guard lock(mutex_);
  endpoints_.push_back(endpoint.get());
  return endpoint;
}

void InMemoryNetwork::deliver(const Endpoint* from, std::string_view sender,
                              std::string_view channel, std::span<const std::byte> payload) {
  const std::lock_guard lock(mutex_);
  const auto chance = [this](double probability) {
    return probability > 0 && std::uniform_real_distribution<double>()(random_) < probability;
  };
  for (Endpoint* to : endpoints_) {
    if (to == from || to->mailbox_.channels.find(channel) < 0) continue;
    if (chance(faults_.loss)) continue;
    const int copies = chance(faults_.duplication) ? 2 : 1;
    for (int copy = 0; copy < copies; ++copy) {
      Message message{
          std::string(channel), {payload.begin(), payload.end()}, std::string(sender), 0};
      if (chance(faults_.reordering)) {
        message.held_back = std::uniform_int_distribution<int>(1, faults_.overtaken_by)(random_);
      }
      put(*to, std::move(message));
    }
  }
}

std::int64_t InMemoryNetwork::num_overflowed(const std::string& name) {
  const std::lock_guard lock(mutex_);
  return num_overflowed_[name];
}

void InMemoryNetwork::put(Endpoint& to, Message message) {
  Mailbox& mailbox = to.mailbox_;
  if (message.held_back > 0) {
    mailbox.held.push_back(std::move(message));
    return;
  }
  if (mailbox.queue.size() >= receive_buffer) {
    ++num_overflowed_[to.name_];
    return;
  }
  mailbox.queue.push_back(std::move(message));
  for (auto held = mailbox.held.begin(); held != mailbox.held.end();) {
    if (--held->held_back > 0) {
      ++held;
      continue;
    }
    mailbox.queue.push_back(std::move(*held));
    held = mailbox.held.erase(held);
  }
  mailbox.arrived.notify_one();
}

}  // namespace tachless::bus
