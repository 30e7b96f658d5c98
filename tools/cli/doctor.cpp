#include "cli/doctor.h"

#include <fmt/format.h>
#include <sched.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <exception>
#include <fstream>
#include <map>
#include <numeric>
#include <sstream>

#include "base/child.h"
#include "base/file_text.h"
#include "base/text.h"
#include "base/this_process.h"
#include "bus/network_check.h"
#include "bus/udp_transport.h"
#include "session/options.h"

namespace tachless::cli {
namespace {

constexpr std::chrono::milliseconds listening_time{300};
// The logger's worst burst: 1000 messages of a 64-joint robot, with the kernel's overhead.
constexpr long useful_receive_buffer_bytes = 2 << 20;
// Locked memory of one process with its libraries.
constexpr std::size_t locked_memory_bytes = std::size_t{256} << 20;
constexpr std::uintmax_t useful_disk_bytes = std::uintmax_t{1} << 30;

std::string human_bytes(double bytes) {
  static constexpr std::array units = {"B", "KiB", "MiB", "GiB", "TiB"};
  std::size_t unit = 0;
  while (bytes >= 1024 && unit + 1 < units.size()) {
    bytes /= 1024;
    ++unit;
  }
  return fmt::format("{:.3g} {}", bytes, units[unit]);
}

Finding check_bus(const bus::LcmUrl& url) {
  const std::string subject = "multicast";
  if (const auto problem = bus::check_network(url)) {
    return {subject, problem->what, problem->remedy};
  }
  const auto route = bus::multicast_route(url);
  return {subject, fmt::format("messages to {} arrive{}", url.text(),
                               route ? ", by way of " + route->interface : "")};
}

Finding check_other_publishers(const bus::LcmUrl& url) {
  bus::UdpTransport transport(url);
  transport.subscribe_all();
  std::map<std::string, std::string> senders;
  const base::Clock::time_point until = base::Clock::now() + listening_time;
  while (base::Clock::now() < until) {
    const auto datagram = transport.receive(until);
    if (datagram && senders.size() < 8) {
      senders.emplace(std::string(datagram->channel), std::string(datagram->sender));
    }
  }
  if (senders.empty()) return {"other publishers", "no other process is on the bus"};
  std::vector<std::string> list;
  list.reserve(senders.size());
  for (const auto& [channel, sender] : senders) {
    list.push_back(fmt::format("{} from {}", base::printable(channel), sender));
  }
  bus::LcmUrl other = url;
  other.port = static_cast<std::uint16_t>(url.port == 65535 ? url.port - 1 : url.port + 1);
  return {"other publishers", base::joined(list),
          fmt::format("export LCM_DEFAULT_URL='{}' (another bus), or run with --isolate",
                      other.text())};
}

Finding check_private_network() {
  const bool works = base::works_in_a_copy([] {
    try {
      base::enter_private_network();
      return true;
    } catch (const std::exception&) {
      return false;
    }
  });
  if (works) return {"private network", "available (--isolate, test)"};
  return {"private network", "refused by the kernel; --isolate and test need it",
          "sudo sysctl -w kernel.unprivileged_userns_clone=1 user.max_user_namespaces=1000"};
}

Finding check_real_time() {
  const bool works = base::works_in_a_copy([] {
    const sched_param priority{1};
    return sched_setscheduler(0, SCHED_FIFO, &priority) == 0;
  });
  if (works) return {"real-time priority", "SCHED_FIFO is permitted"};
  return {"real-time priority", "SCHED_FIFO is not permitted; only --mode realtime needs it",
          "echo \"$USER - rtprio 80\" | sudo tee /etc/security/limits.d/tachless-rtprio.conf, then "
          "log in again"};
}

Finding check_locked_memory() {
  const bool works = base::works_in_a_copy([] {
    void* memory = mmap(nullptr, locked_memory_bytes, PROT_READ | PROT_WRITE,
                        MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
    // MLOCK_ONFAULT asks for the right without filling the memory.
    return memory != MAP_FAILED && mlock2(memory, locked_memory_bytes, MLOCK_ONFAULT) == 0;
  });
  if (works) return {"locked memory", "permitted"};
  return {"locked memory",
          fmt::format("less than {} is permitted; only --mode realtime needs it",
                      human_bytes(locked_memory_bytes)),
          "echo \"$USER - memlock unlimited\" | sudo tee "
          "/etc/security/limits.d/tachless-memlock.conf, then log in again"};
}

Finding check_clock() {
  std::ifstream file("/sys/devices/system/clocksource/clocksource0/current_clocksource");
  std::string source;
  file >> source;
  return judge_clock_source(source);
}

Finding check_stolen_time() {
  return judge_stolen_time(base::file_text("/proc/stat").value_or(""));
}

/// Checks how punctual this machine can be.
std::vector<Finding> check_punctuality() {
  return {check_real_time(), check_locked_memory(), check_clock(), check_stolen_time()};
}

}  // namespace

Finding judge_ttl(const bus::LcmUrl& url, const std::string& interface) {
  if (url.ttl == 0) return {"ttl", "0: messages stay on this host"};
  if (interface == "lo") {
    return {"ttl",
            fmt::format("{}, but the multicast route is by way of lo: nothing leaves this host",
                        url.ttl),
            "sudo ip route replace 224.0.0.0/4 dev eth0 (or what ip -brief link calls the "
            "interface to the other hosts)"};
  }
  if (url.ttl == 1) return {"ttl", "1: messages reach the local network"};
  bus::LcmUrl local = url;
  local.ttl = 1;
  return {"ttl", fmt::format("{}: messages are routed on", url.ttl),
          fmt::format("export LCM_DEFAULT_URL='{}'", local.text())};
}

Finding judge_receive_buffer(long rmem_max_bytes) {
  Finding finding{"receive buffer",
                  "net.core.rmem_max allows " + human_bytes(static_cast<double>(rmem_max_bytes))};
  if (rmem_max_bytes >= useful_receive_buffer_bytes) return finding;
  finding.what += "; bursts of messages need more";
  finding.remedy = fmt::format("sudo sysctl -w net.core.rmem_max={}", useful_receive_buffer_bytes);
  return finding;
}

Finding judge_clock_source(const std::string& source) {
  if (source.empty()) return {"clock source", "the kernel does not tell"};
  if (source != "hpet" && source != "acpi_pm" && source != "jiffies") {
    return {"clock source", source};
  }
  return {"clock source", source + " is slow to read",
          "echo tsc | sudo tee /sys/devices/system/clocksource/clocksource0/current_clocksource"};
}

Finding judge_stolen_time(const std::string& proc_stat) {
  constexpr double harmless = 0.001;
  // user, nice, system, idle, iowait, irq, softirq, steal: what follows is contained in them.
  constexpr std::size_t num_shares = 8;
  std::istringstream words(proc_stat);
  std::string label;
  std::array<double, num_shares> ticks{};
  words >> label;
  for (double& each : ticks) words >> each;
  const double all = std::accumulate(ticks.begin(), ticks.end(), 0.0);
  if (!words || label != "cpu" || all == 0) return {"stolen time", "the kernel does not tell"};
  const double share = ticks.back() / all;
  Finding finding{
      "stolen time",
      fmt::format("the host took {:.2f} % of this machine's time since it started", 100 * share)};
  if (share <= harmless) return finding;
  finding.what +=
      "; --mode realtime may end in protective stops: a real robot needs a machine of "
      "its own, the emulator --set loop.max_missed=100";
  finding.warns = true;
  return finding;
}

Finding judge_disk(std::uintmax_t free_bytes, const std::filesystem::path& directory) {
  Finding finding{"disk",
                  fmt::format("{} free in {}", human_bytes(static_cast<double>(free_bytes)),
                              std::filesystem::absolute(directory).lexically_normal().string())};
  if (free_bytes < useful_disk_bytes)
    finding.remedy = "run with --out DIR on a disk with more free space";
  return finding;
}

std::vector<Bin> bins_of(const std::vector<session::LatencyHistogram::Bucket>& buckets) {
  const auto edge_us = [](int n) {
    constexpr std::array<double, 3> steps = {1, 2, 5};
    return n < 0 ? 0 : steps[static_cast<std::size_t>(n % 3)] * std::pow(10, n / 3);
  };
  std::vector<Bin> bins;
  int n = -1;
  for (const session::LatencyHistogram::Bucket& bucket : buckets) {
    while (bucket.from_us >= edge_us(n + 1)) {
      ++n;
      if (!bins.empty()) bins.push_back({edge_us(n), edge_us(n + 1)});
    }
    if (bins.empty()) bins.push_back({edge_us(n), edge_us(n + 1)});
    bins.back().count += bucket.count;
  }
  return bins;
}

std::string text(const std::vector<Bin>& bins) {
  constexpr std::int64_t widest = 40;
  std::int64_t most = 1;
  for (const Bin& bin : bins) most = std::max(most, bin.count);
  std::string lines;
  for (const Bin& bin : bins) {
    const auto width = static_cast<std::size_t>((widest * bin.count + most - 1) / most);
    lines += fmt::format("{:>12g} to {:>6g} us {:>9}{}{}\n", bin.from_us, bin.to_us, bin.count,
                         width > 0 ? "  " : "", std::string(width, '#'));
  }
  return lines;
}

std::vector<Finding> examine_punctuality() {
  std::vector<Finding> findings = check_punctuality();
  std::erase_if(findings, [](const Finding& finding) { return finding.ok(); });
  return findings;
}

std::vector<Finding> examine(const std::string& lcm_url, const std::filesystem::path& directory) {
  std::vector<Finding> findings;
  try {
    const bus::LcmUrl url = bus::parse_lcm_url(lcm_url);
    findings.push_back(check_bus(url));
    const bool usable = findings.back().ok();
    const auto route = bus::multicast_route(url);
    findings.push_back(judge_ttl(url, route ? route->interface : std::string()));
    if (usable) findings.push_back(check_other_publishers(url));
  } catch (const std::invalid_argument& error) {
    findings.push_back({"multicast", error.what(),
                        fmt::format("export LCM_DEFAULT_URL='{}'", session::default_lcm_url)});
  }
  findings.push_back(judge_receive_buffer(bus::receive_buffer_limit_bytes()));
  findings.push_back(check_private_network());
  for (Finding& finding : check_punctuality()) findings.push_back(std::move(finding));
  findings.push_back(judge_disk(std::filesystem::space(directory).available, directory));
  return findings;
}

}  // namespace tachless::cli
