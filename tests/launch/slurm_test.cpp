// A sweep on a real Slurm cluster of two nodes on this machine.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <charconv>
#include <fstream>
#include <memory>
#include <random>
#include <regex>

#include "tests/support/private_network.h"
#include "tests/support/program.h"
#include "tests/support/shell.h"
#include "tests/support/temporary_directory.h"

namespace {

using std::chrono::seconds;
using std::chrono::steady_clock;
using testing::HasSubstr;

namespace fs = std::filesystem;

template <class Condition>
bool becomes_true(const Condition& condition, seconds limit) {
  const auto deadline = steady_clock::now() + limit;
  while (!condition()) {
    if (steady_clock::now() > deadline) return false;
    usleep(50'000);
  }
  return true;
}

class Cluster {
 public:
  Cluster() {
    // Slurm looks up names only where there is an address besides the loopback's.
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
    if (!becomes_true([&] { return fs::exists(d + "/munge.socket"); }, seconds(30))) {
      throw std::runtime_error("munged: " + munge_->errors());
    }
    controller_ = daemon({"slurmctld", "-D", "-f", config_});
    nodes_[0] = daemon({"slurmd", "-D", "-N", "n1", "-f", config_});
    nodes_[1] = daemon({"slurmd", "-D", "-N", "n2", "-f", config_});
    const auto both_idle = [] {
      return tachless::support::shell("sinfo --noheader --format '%T %D'").output == "idle 2\n";
    };
    if (!becomes_true(both_idle, seconds(60))) {
      throw std::runtime_error("the cluster is not up: " + controller_->errors() +
                               nodes_[0]->errors() + nodes_[1]->errors());
    }
  }

  ~Cluster() {
    kill_jobs_of("n1");
    kill_jobs_of("n2");
    for (auto& node : nodes_) node.reset();
    controller_.reset();
    munge_.reset();
    unsetenv("SLURM_CONF");
  }

  Cluster(const Cluster&) = delete;
  Cluster& operator=(const Cluster&) = delete;

  /// The machine of node 2 loses its power.
  void kill_second_node() {
    nodes_[1]->signal(SIGKILL);
    kill_jobs_of("n2");
  }

 private:
  std::unique_ptr<Program> daemon(const std::vector<std::string>& command) {
    std::vector<std::string> words = {"LD_PRELOAD=" TACHLESS_ANY_USER_GROUPS};
    words.insert(words.end(), command.begin(), command.end());
    return std::make_unique<Program>("env", words, directory_.path());
  }

  /// What runs on that node under this cluster's configuration, its slurmstepd first: that one
  /// would report the end of a job.
  void kill_jobs_of(const std::string& node) const {
    std::vector<pid_t> jobs, steps;
    for (const fs::directory_entry& entry : fs::directory_iterator("/proc")) {
      const std::string name = entry.path().filename().string();
      pid_t pid = 0;
      std::from_chars(name.data(), name.data() + name.size(), pid);
      const std::string environment = pid > 0 ? contents(entry.path() / "environ") : "";
      if (environment.find("SLURMD_NODENAME=" + node) == std::string::npos ||
          environment.find("SLURM_CONF=" + config_) == std::string::npos) {
        continue;
      }
      jobs.push_back(pid);
      std::smatch parent;
      const std::string status = contents(entry.path() / "status");
      if (!std::regex_search(status, parent, std::regex("PPid:\\s*([0-9]+)"))) continue;
      if (contents("/proc/" + parent[1].str() + "/cmdline").starts_with("slurmstepd")) {
        steps.push_back(std::stoi(parent[1]));
      }
    }
    for (const pid_t pid : steps) ::kill(pid, SIGKILL);
    for (const pid_t pid : jobs) ::kill(pid, SIGKILL);
  }

  TemporaryDirectory directory_;
  std::string config_;
  std::unique_ptr<Program> munge_, controller_;
  std::array<std::unique_ptr<Program>, 2> nodes_;
};

std::vector<std::string> sweep(const fs::path& out) {
  return {"sweep",  TACHLESS_SOURCE_DIR "/scenarios/practical_rigid.yaml",
          "--set",  "plant.mechanics=native",
          "--set",  "loop.duration_s=2",
          "--vary", "controller.gains.kp*=0.5:5:30:log",
          "--vary", "controller.gains.kd*=0.5:2:5",
          "--out",  out.string()};
}

TEST(SweepOnSlurm, IsWholeWhenANodeIsKilledInTheMiddle) {
  const TemporaryDirectory directory;
  Cluster cluster;
  std::vector<std::string> submit = sweep(directory / "cluster");
  submit.insert(submit.end(), {"--slurm", "4"});
  Program submitted("tachless", submit, directory.path());
  ASSERT_EQ(submitted.wait(), 0) << submitted.errors();
  EXPECT_THAT(submitted.output(), HasSubstr("4 tasks, 150 runs"));
  const auto rows_of = [&](int part) {
    const std::string rows =
        contents(directory / "cluster" / ("rows-" + std::to_string(part) + "-of-4.csv"));
    return std::count(rows.begin(), rows.end(), '\n');
  };
  // Both nodes are at work; the second has the second task.
  ASSERT_TRUE(becomes_true([&] { return rows_of(1) > 0 && rows_of(2) > 2; }, seconds(120)));
  cluster.kill_second_node();
  EXPECT_LT(rows_of(2), 38);
  Program status("tachless", {"sweep", (directory / "cluster").string(), "--status"},
                 directory.path());
  EXPECT_EQ(status.wait(), 0);
  EXPECT_THAT(status.output(), HasSubstr("of 150 runs finished"));
  EXPECT_THAT(status.output(), HasSubstr("rows-2-of-4.csv"));
  // Slurm starts a task anew two minutes after its node has failed; we do not wait for that.
  const std::string at_once =
      "squeue --noheader --states=PENDING --format '%F_%K' | grep -x '[0-9]*_[0-9]*' | "
      "xargs -r -I{} scontrol update JobId={} StartTime=now";
  const fs::path results = directory / "cluster" / "index.html";  // written last
  EXPECT_TRUE(becomes_true(
      [&] {
        tachless::support::shell(at_once);
        return fs::exists(results);
      },
      seconds(150)))
      << status.output() << tachless::support::shell("squeue; sinfo").output
      << contents(directory / "cluster" / "slurm-merge.txt");
  Program alone("tachless", sweep(directory / "alone"), directory.path());
  ASSERT_EQ(alone.wait(), 0) << alone.errors();
  EXPECT_TRUE(contents(directory / "cluster" / "results.csv") ==
              contents(directory / "alone" / "results.csv"));
}

}  // namespace
