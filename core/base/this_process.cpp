#include "base/this_process.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <fmt/core.h>
#include <net/if.h>
#include <net/route.h>
#include <poll.h>
#include <sched.h>
#include <sys/ioctl.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstddef>
#include <cstring>
#include <stdexcept>
#include <string>
#include <system_error>

#include "base/file_descriptor.h"

namespace tachless::base {
namespace {

std::atomic<bool> interrupted{false};
static_assert(std::atomic<bool>::is_always_lock_free, "set by a signal handler");

[[noreturn]] void fail(const std::string& step, const std::string& remedy) {
  throw std::system_error(errno, std::generic_category(),
                          fmt::format("private network: cannot {} ({})", step, remedy));
}

void write_file(const char* path, const std::string& text) {
  const FileDescriptor file(::open(path, O_WRONLY | O_CLOEXEC));
  const auto size = static_cast<ssize_t>(text.size());
  if (file.get() < 0 || ::write(file.get(), text.data(), text.size()) != size) {
    fail(std::string("write ") + path, "run as root");
  }
}

void enter_namespaces() {
  if (::unshare(CLONE_NEWNET) == 0) return;
  const std::string uid_map = fmt::format("0 {} 1", ::getuid());
  const std::string gid_map = fmt::format("0 {} 1", ::getgid());
  if (::unshare(CLONE_NEWUSER | CLONE_NEWNET) != 0) {
    if (errno == EINVAL) fail("leave a process that has threads already", "call it first");
    fail("make a user namespace",
         "run as root, or allow it: sysctl -w user.max_user_namespaces=1000 "
         "kernel.unprivileged_userns_clone=1; in Docker: --cap-add SYS_ADMIN");
  }
  write_file("/proc/self/setgroups", "deny");
  write_file("/proc/self/uid_map", uid_map);
  write_file("/proc/self/gid_map", gid_map);
}

sockaddr ipv4(const char* text) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  inet_pton(AF_INET, text, &address.sin_addr);
  sockaddr result{};
  std::memcpy(&result, &address, sizeof result);
  return result;
}

}  // namespace

const std::atomic<bool>& catch_interruptions() {
  struct sigaction action {};
  action.sa_handler = [](int /*signal*/) { interrupted = true; };
  sigemptyset(&action.sa_mask);
  const auto handle = [&](int signal) {
    if (sigaction(signal, &action, nullptr) != 0) throw std::logic_error("sigaction failed");
  };
  for (const int signal : {SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGPIPE, SIGALRM, SIGVTALRM, SIGPROF,
                           SIGUSR1, SIGUSR2, SIGIO, SIGPWR, SIGXCPU, SIGSTKFLT}) {
    handle(signal);
  }
  for (int signal = SIGRTMIN; signal <= SIGRTMAX; ++signal) handle(signal);
  return interrupted;
}

void set_low_priority() {
  [[maybe_unused]] const int refused = setpriority(PRIO_PROCESS, 0, 10);  // of this thread alone
}

std::vector<int> allowed_cpus() {
  cpu_set_t set;
  CPU_ZERO(&set);
  std::vector<int> cpus;
  if (sched_getaffinity(0, sizeof set, &set) == 0) {
    for (int cpu = 0; cpu < CPU_SETSIZE; ++cpu) {
      if (CPU_ISSET(static_cast<std::size_t>(cpu), &set)) cpus.push_back(cpu);
    }
  }
  if (cpus.empty()) cpus.push_back(std::max(sched_getcpu(), 0));
  return cpus;
}

bool execute_on(const std::vector<int>& cpus) {
  if (cpus.empty()) return true;
  cpu_set_t set;
  CPU_ZERO(&set);
  for (const int cpu : cpus) CPU_SET(static_cast<std::size_t>(cpu), &set);
  return sched_setaffinity(0, sizeof set, &set) == 0;
}

void survive_file_size_limit() { std::signal(SIGXFSZ, SIG_IGN); }

void survive_broken_pipes() { std::signal(SIGPIPE, SIG_IGN); }

void open_standard_streams() {
  for (const int standard : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO}) {
    if (::fcntl(standard, F_GETFD) < 0) ::open("/dev/null", O_RDWR);  // takes the lowest number
  }
}

void give_up_blocked_output() {
  constexpr int patience_ms = 1000;
  const FileDescriptor nothing(::open("/dev/null", O_WRONLY | O_CLOEXEC));
  for (const int standard : {STDOUT_FILENO, STDERR_FILENO}) {
    pollfd output{standard, POLLOUT, 0};
    if (::poll(&output, 1, patience_ms) == 0) ::dup2(nothing.get(), standard);
  }
}

void make_memory_private() {
  if (::prctl(PR_SET_DUMPABLE, 0UL) != 0) {
    throw std::system_error(errno, std::generic_category(), "prctl(PR_SET_DUMPABLE)");
  }
}

void enter_private_network() {
  enter_namespaces();
  const FileDescriptor socket(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  if (socket.get() < 0) fail("open a socket", "the kernel has no IPv4");
  std::string device = "lo";
  ifreq interface {};
  std::strcpy(interface.ifr_name, device.c_str());
  if (::ioctl(socket.get(), SIOCGIFFLAGS, &interface) != 0) fail("look at lo", "run as root");
  interface.ifr_flags |= IFF_UP | IFF_MULTICAST;
  if (::ioctl(socket.get(), SIOCSIFFLAGS, &interface) != 0) fail("bring lo up", "run as root");
  rtentry route{};
  route.rt_dst = ipv4("224.0.0.0");
  route.rt_genmask = ipv4("240.0.0.0");
  route.rt_flags = RTF_UP;
  route.rt_dev = device.data();
  if (::ioctl(socket.get(), SIOCADDRT, &route) != 0) fail("add the multicast route", "run as root");
}

std::filesystem::path program_directory() {
  return std::filesystem::read_symlink("/proc/self/exe").parent_path();
}

std::filesystem::path shared_directory() {
  return program_directory().parent_path() / "share/tachless";
}

}  // namespace tachless::base
