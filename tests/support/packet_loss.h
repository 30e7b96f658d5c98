#pragma once

#include <cstdlib>
#include <stdexcept>
#include <string>

namespace tachless::support {

/// Guard that makes this network namespace lose packets of the bus while it exists, by a rule of
/// nftables.
class PacketLoss {
 public:
  explicit PacketLoss(int percent)
      : PacketLoss("numgen random mod 100 '<' " + std::to_string(percent)) {}
  /// @param which selects the packets, as an expression of nft
  explicit PacketLoss(const std::string& which) {
    nft("add table ip lossy");
    nft("add chain ip lossy in '{ type filter hook input priority 0; }'");
    nft("add rule ip lossy in udp dport 7667 " + which + " drop");
  }
  PacketLoss(const PacketLoss&) = delete;
  PacketLoss& operator=(const PacketLoss&) = delete;
  ~PacketLoss() { [[maybe_unused]] const int end = std::system("nft delete table ip lossy"); }

 private:
  static void nft(const std::string& words) {
    if (std::system(("nft " + words).c_str()) != 0) throw std::runtime_error("nft " + words);
  }
};

}  // namespace tachless::support
