#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>

#include "bus/transport.h"

namespace tachless::system_test {

/// Passes everything on; derived classes change something.
class Wrapped : public bus::Transport {
 public:
  explicit Wrapped(std::unique_ptr<bus::Transport> inner) : inner_(std::move(inner)) {}
  void subscribe(const std::string& channel) override { inner_->subscribe(channel); }
  void publish(std::string_view channel, std::span<const std::byte> payload) override {
    inner_->publish(channel, payload);
  }
  std::optional<bus::Datagram> receive(loop::Clock::time_point deadline) override {
    return inner_->receive(deadline);
  }

 private:
  std::unique_ptr<bus::Transport> inner_;
};

}  // namespace tachless::system_test
