// A sweep on a real Slurm cluster of two nodes on this machine.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <fstream>
#include <memory>
#include <random>

#include "tests/support/private_network.h"
#include "tests/support/program.h"
#include "tests/support/shell.h"
#include "tests/support/temporary_directory.h"

namespace {

using testing::HasSubstr;

namespace fs = std::filesystem;

class Cluster {
 public:
  Cluster() {
    // Slurm looks up names only where there is another address than the loopback's.
    tachless::support::shell("ip address add 10.11.12.13/32 dev lo");
    const std::string d = directory_.path().string();
    std::random_device random;
    std::ofstream key(d + "/key", std::ios::binary);
    for (int i = 0; i < 128; ++i) key.put(static_cast<char>(random()));
    key.close();
    fs::permissions(d + "/key", fs::perms::owner_read);
    fs::create_directory(d + "/state");
    std::ofstream(d + "/slurm.conf")
        << "ClusterName=test\nSlurmctldHost=localhost(127.0.0.1)\nSlurmctldPort=16817\n"
           "SlurmUser=root\nSlurmdUser=root\nAuthType=auth/munge\nCredType=cred/munge\n"
        << "AuthInfo=socket=" << d << "/munge.socket\nStateSaveLocation=" << d << "/state\n"
        << "SlurmdSpoolDir=" << d << "/spool-%n\nSlurmctldPidFile=" << d << "/ctld.pid\n"
        << "SlurmdPidFile=" << d << "/slurmd-%n.pid\n"
        << "ProctrackType=proctrack/linuxproc\nTaskPlugin=task/none\n"
           "SelectType=select/cons_tres\nSelectTypeParameters=CR_CPU\nSlurmdTimeout=5\n"
           "ReturnToService=2\nMpiDefault=none\nKillWait=1\n"
           "NodeName=n1 NodeHostname=localhost NodeAddr=127.0.0.1 Port=17001 CPUs=1\n"
           "NodeName=n2 NodeHostname=localhost NodeAddr=127.0.0.1 Port=17002 CPUs=1\n"
           "PartitionName=p Nodes=n1,n2 Default=YES State=UP\n";
    config_ = d + "/slurm.conf";
    setenv("SLURM_CONF", config_.c_str(), 1);
    munge_ = std::make_unique<Program>(
        "munged",
        std::vector<std::string>{"--force", "--foreground", "--key-file=" + d + "/key",
                                 "--socket=" + d + "/munge.socket", "--pid-file=" + d + "/pid",
                                 "--log-file=" + d + "/munged.log", "--seed-file=" + d + "/seed"},
        directory_.path());
    wait_until("munged", [&] { return fs::exists(d + "/munge.socket"); });
    controller_ = daemon({"slurmctld", "-D", "-f", config_});
    nodes_[0] = daemon({"slurmd", "-D", "-N", "n1", "-f", config_});
    nodes_[1] = daemon({"slurmd", "-D", "-N", "n2", "-f", config_});
    wait_until("both nodes", [] {
      return tachless::support::shell("sinfo --noheader --format '%T %D'").output == "idle 2\n";
    });
  }

  ~Cluster() {
    tachless::support::shell("scancel --signal=KILL --full --user=root");
    for (auto& node : nodes_) node.reset();
    controller_.reset();
    munge_.reset();
    unsetenv("SLURM_CONF");
  }

  Cluster(const Cluster&) = delete;
  Cluster& operator=(const Cluster&) = delete;

 private:
  std::unique_ptr<Program> daemon(const std::vector<std::string>& command) {
    std::vector<std::string> words = {"LD_PRELOAD=" TACHLESS_ANY_USER_GROUPS};
    words.insert(words.end(), command.begin(), command.end());
    return std::make_unique<Program>("env", words, directory_.path());
  }

  TemporaryDirectory directory_;
  std::string config_;
  std::unique_ptr<Program> munge_, controller_;
  std::array<std::unique_ptr<Program>, 2> nodes_;
};

std::vector<std::string> sweep(const fs::path& out) {
  return {"sweep",    TACHLESS_SOURCE_DIR "/scenarios/practical_rigid.yaml",
          "--set",    "plant.mechanics=native",
          "--set",    "loop.duration_s=0.2",
          "--vary",   "controller.gains.kp*=0.5:5:6:log",
          "--vary",   "controller.gains.kd*=0.5:2:5",
          "--out",    out.string(),
          "--colour", "rms_error"};
}

TEST(SweepOnSlurm, HasTheResultsOfOneProgram) {
  const TemporaryDirectory directory;
  Cluster cluster;
  std::vector<std::string> submit = sweep(directory / "cluster");
  submit.insert(submit.end(), {"--slurm", "4"});
  Program submitted("tachless", submit, directory.path());
  ASSERT_EQ(submitted.wait(), 0) << submitted.errors();
  EXPECT_THAT(submitted.output(), HasSubstr("4 tasks, 30 runs"));
  wait_until("the results", [&] { return fs::exists(directory / "cluster/index.html"); });
  Program status("tachless", {"sweep", directory / "cluster", "--status"}, directory.path());
  EXPECT_EQ(status.wait(), 0);
  EXPECT_THAT(status.output(), HasSubstr("30 of 30 runs finished"));
  EXPECT_THAT(status.output(), HasSubstr("rows-2-of-4.csv"));
  Program alone("tachless", sweep(directory / "alone"), directory.path());
  ASSERT_EQ(alone.wait(), 0) << alone.errors();
  EXPECT_TRUE(contents(directory / "cluster/results.csv") ==
              contents(directory / "alone/results.csv"));
  EXPECT_TRUE(contents(directory / "cluster/map.svg") == contents(directory / "alone/map.svg"));
}

}  // namespace
