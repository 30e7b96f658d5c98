#pragma once

#include <sched.h>
#include <sys/mount.h>

#include <cerrno>
#include <string>
#include <system_error>

#include "tests/support/program.h"

/// A disk of its own size that only this process and those it starts can see. Precondition: the
/// process may mount, as it may after `tachless::base::enter_private_network`.
class SmallDisk {
 public:
  explicit SmallDisk(int kib) {
    leave_the_hosts_mounts();
    mount_with("size=" + std::to_string(kib) + "k", 0);
  }
  SmallDisk(const SmallDisk&) = delete;
  SmallDisk& operator=(const SmallDisk&) = delete;
  ~SmallDisk() { umount2(directory_.path().c_str(), MNT_DETACH); }

  void make_read_only() { mount_with("", MS_REMOUNT | MS_RDONLY); }
  [[nodiscard]] std::string operator/(const std::string& name) const { return directory_ / name; }

 private:
  static void leave_the_hosts_mounts() {
    static const bool left =
        unshare(CLONE_NEWNS) == 0 && mount("none", "/", nullptr, MS_REC | MS_PRIVATE, nullptr) == 0;
    if (!left) throw std::system_error(errno, std::generic_category(), "mount namespace");
  }
  void mount_with(const std::string& options, unsigned long flags) {
    if (mount("none", directory_.path().c_str(), "tmpfs", flags, options.c_str()) != 0) {
      throw std::system_error(errno, std::generic_category(), "mount");
    }
  }

  TemporaryDirectory directory_;
};
