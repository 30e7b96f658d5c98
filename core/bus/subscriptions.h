#pragma once

#include <algorithm>
#include <string>
#include <string_view>
#include <vector>

namespace tachless::bus {

/// Channels that a transport has subscribed to, numbered in the order of subscription.
class Subscriptions {
 public:
  /// Adds a channel unless it is known.
  /// @return the channel's number, the same one each time
  int add(std::string_view channel) {
    const int known = find(channel);
    if (known >= 0) return known;
    channels_.emplace_back(channel);
    return static_cast<int>(channels_.size()) - 1;
  }
  /// Finds a channel.
  /// @return the channel's number; -1 without a subscription to it
  [[nodiscard]] int find(std::string_view channel) const {
    const auto found = std::ranges::find(channels_, channel);
    return found == channels_.end() ? -1 : static_cast<int>(found - channels_.begin());
  }
  [[nodiscard]] const std::vector<std::string>& all() const { return channels_; }

 private:
  std::vector<std::string> channels_;
};

}  // namespace tachless::bus
