#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>

#include "base/failure.h"
#include "logger/export.h"
#include "logger/info.h"
#include "logger/run_log.h"
#include "tests/support/damaged_log.h"
#include "tests/support/recorded_run.h"
#include "tests/support/temporary_directory.h"

namespace tachless::logger {
namespace {

/// Tests everything that reads logs with damaged logs. Nothing crashes or loops, and intact data is
/// read.
class Damage : public testing::Test {
 protected:
  TemporaryDirectory directory_{quick_place()};
  std::filesystem::path path_ = directory_.path() / "lcmlog";
  std::filesystem::path csv_ = directory_.path() / "run.csv";
};

TEST_F(Damage, NothingCrashesAndIntactCommandsAreRead) {
  const auto run = recorded_run("paper_rigid.yaml", {"loop.duration_s=0.0005"}, "POSITION");
  auto messages = run.messages;
  messages.push_back(messages[0]);  // a second RUN_INFO keeps most logs readable
  messages.push_back(fault_message(run, "encoder lost"));
  const SampleLog log = index_of(log_of(messages));
  const DamagePlan plan = damage_plan();
  std::uint64_t readable = 0;
  for (std::uint64_t seed = 0; seed < plan.logs; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const auto damaged = damaged_at_random(log, seed);
    write_file(path_, damaged.bytes);

    const auto info = read_info(path_);
    ASSERT_FALSE(to_text(info).empty());
    ASSERT_NO_THROW(info.dump());
    // Every message of an intact tick is an event on some channel.
    ASSERT_GE(info["messages"], damaged.intact.size());

    try {
      auto run_log = RunLog::open(path_);
      ++readable;
      std::set<std::int64_t> commands;
      TickRecord record;
      std::int64_t last = -1;
      while (run_log.next(record)) {
        ASSERT_GT(record.tick, last);
        last = record.tick;
        if (record.command) commands.insert(record.tick);
      }
      const auto& summary = run_log.summary();
      for (const auto& [offset, index] : damaged.intact) {
        if (run_log.run() != run.run) break;  // the only RUN_INFO left has a damaged run number
        if (log.events[index].channel != "ARM_COMMAND") continue;
        const auto tick = static_cast<std::int64_t>(index - 1) / 6;
        ASSERT_TRUE(commands.contains(tick)) << "COMMAND of tick " << tick << " was lost";
      }
      if (commands.size() < run.ticks.size() && last + 1 == run.info.num_ticks) {
        ASSERT_GT(summary.gaps(), 0u);
      }
      export_run(run_log, csv_, true);
    } catch (const base::Failure& failure) {
      ASSERT_EQ(failure.code(), base::ExitCode::bad_usage);
      ASSERT_NE(std::string(failure.what()).find(path_.string()), std::string::npos)
          << failure.what();
    }
  }
  EXPECT_GT(readable, plan.logs / 2);
  RecordProperty("readable", std::to_string(readable));
}

}  // namespace
}  // namespace tachless::logger
