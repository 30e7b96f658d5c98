#pragma once

#include <string>
#include <vector>

#include "base/file_descriptor.h"
#include "tests/support/program.h"
#include "tests/system/four_programs.h"

namespace tachless::system_test {

/// Four hosts on a switch, one for each role: network namespaces with a name and an address of
/// their own, joined by a bridge. The switch is in the namespace of the caller, which has to be a
/// private one (tests/bus/private_network.h) and single-threaded.
class FourHosts {
 public:
  /// The default bus, as far as the switch reaches.
  static constexpr const char* bus = "udpm://239.255.76.67:7667?ttl=1";

  FourHosts();
  ~FourHosts();
  FourHosts(const FourHosts&) = delete;
  FourHosts& operator=(const FourHosts&) = delete;

  /// While it lives, whatever this thread starts or opens is on one host.
  class Visit {
   public:
    Visit(const FourHosts& hosts, const std::string& role);
    ~Visit();
    Visit(const Visit&) = delete;
    Visit& operator=(const Visit&) = delete;

   private:
    const FourHosts& hosts_;
  };

  /// Pulls the cable between the role's host and the switch, and puts it back.
  void unplug(const std::string& role) const { set_port(role, false); }
  void plug(const std::string& role) const { set_port(role, true); }

  /// By a firewall on the role's host.
  void forbid_sending(const std::string& role) const;

  /// From now on every host drops so many percent of what the bus brings.
  void lose(int percent) const;

 private:
  struct Namespaces {
    base::FileDescriptor network, name;
  };

  static Namespaces here();
  static void enter(const Namespaces& namespaces);
  [[nodiscard]] const Namespaces& of(const std::string& role) const;
  static void set_port(const std::string& role, bool up);

  Namespaces switch_;
  std::vector<Namespaces> hosts_;  // in the order of `roles`
};

/// The four programs of one run, each on its host.
class FourHostsRun {
 public:
  explicit FourHostsRun(const std::string& scenario) : programs(scenario) {}

  Program& start(const std::string& role) {
    const FourHosts::Visit visit(hosts, role);
    return programs.start(role, {"--lcm-url", FourHosts::bus});
  }
  void start_all() {
    for (const char* role : roles) start(role);
  }
  Program& operator[](const std::string& role) { return programs[role]; }

  FourHosts hosts;
  FourPrograms programs;
};

}  // namespace tachless::system_test
