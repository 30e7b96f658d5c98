#include "tests/soak/packet_loss.h"

#include <fmt/core.h>
#include <unistd.h>

#include <exception>
#include <filesystem>
#include <string>
#include <vector>

#include "diagnostics/failure.h"
#include "tests/soak/driver.h"
#include "tests/soak/hostile_traffic.h"

namespace tachless::soak {
namespace {

std::filesystem::path nft() {
  for (const char* path : {"/usr/sbin/nft", "/sbin/nft", "/usr/bin/nft"}) {
    if (access(path, X_OK) == 0) return path;
  }
  throw diagnostics::Failure(
      diagnostics::ExitCode::bad_usage,
      "packets are lost by nft, which is not there: apt-get install nftables");
}

void order(std::vector<std::string> words) {
  words.insert(words.begin(), nft().string());
  if (const auto failure = failure_of(words)) {
    throw diagnostics::Failure(diagnostics::ExitCode::bad_usage,
                               "cannot make the network lose packets: " + *failure);
  }
}

}  // namespace

PacketLoss::PacketLoss(int percent) {
  order({"add", "table", "ip", "soak"});
  order({"add", "chain", "ip", "soak", "in", "{ type filter hook input priority 0; }"});
  order({"add", "rule", "ip", "soak", "in", "udp", "dport", fmt::format("{}", HostileTraffic::port),
         "numgen", "random", "mod", "100", "<", fmt::format("{}", percent), "drop"});
}

PacketLoss::~PacketLoss() {
  try {
    order({"delete", "table", "ip", "soak"});
  } catch (const std::exception&) {
    // The next round's `add` fails and reports it.
  }
}

void PacketLoss::require() { nft(); }

}  // namespace tachless::soak
