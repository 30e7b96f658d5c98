#pragma once

namespace tachless::soak {

/// Makes this process's network lose packets of the bus while it lives. One at a time.
class PacketLoss {
 public:
  /// @throw diagnostics::Failure(bad_usage) when the network cannot be made to, (interrupted) when
  /// the user ends it
  explicit PacketLoss(int percent);
  PacketLoss(const PacketLoss&) = delete;
  PacketLoss& operator=(const PacketLoss&) = delete;
  ~PacketLoss();

  /// @throw diagnostics::Failure(bad_usage) when the program that does it is missing
  static void require();
};

}  // namespace tachless::soak
