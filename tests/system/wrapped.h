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
  int subscribe(const std::string& channel) override { return inner_->subscribe(channel); }
  void publish(std::string_view channel, std::span<const std::byte> payload) override {
    inner_->publish(channel, payload);
  }
  std::optional<bus::Datagram> receive(base::Clock::time_point deadline) override {
    return inner_->receive(deadline);
  }

 private:
  std::unique_ptr<bus::Transport> inner_;
};

/// Falls silent at its nth message: nothing is sent any more, nothing is received.
class Mortal : public Wrapped {
 public:
  Mortal(std::unique_ptr<bus::Transport> inner, int last)
      : Wrapped(std::move(inner)), last_(last) {}
  void publish(std::string_view channel, std::span<const std::byte> payload) override {
    if (++published_ < last_) Wrapped::publish(channel, payload);
  }
  std::optional<bus::Datagram> receive(base::Clock::time_point deadline) override {
    auto datagram = Wrapped::receive(deadline);
    if (published_ >= last_) return std::nullopt;
    return datagram;
  }

 private:
  int last_;
  int published_ = 0;
};

}  // namespace tachless::system_test
