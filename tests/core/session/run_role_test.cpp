#include "session/run_role.h"

#include <gtest/gtest.h>

#include <cerrno>
#include <stdexcept>
#include <system_error>

#include "tests/support/temporary_directory.h"

namespace tachless::session {
namespace {

using base::ExitCode;

template <class Thrown>
Statistics statistics_after(const Thrown& thrown) {
  const TemporaryDirectory directory;
  ProcessOptions options;
  options.scenario_path = TACHLESS_SOURCE_DIR "/scenarios/paper_rigid.yaml";
  options.lcm_url = "udpm://239.255.76.67:7703?ttl=0";
  options.stats_path = directory / "stats.json";
  const auto fails = [&](const scenario::Scenario&, Session&) { throw thrown; };
  EXPECT_THROW(run_role(messages::Role::plant, options, fails), Thrown);
  return statistics_from_json(base::given_text(options.stats_path));
}

TEST(RunRole, WritesItsStatisticsWhateverEndsIt) {
  const base::Failure stop(ExitCode::protective_stop, "drive 2 is too hot");
  EXPECT_EQ(statistics_after(stop).exit_code, ExitCode::protective_stop);
  const Statistics unknown = statistics_after(std::runtime_error("cable"));
  EXPECT_EQ(unknown.exit_code, ExitCode::protocol_violated);
  EXPECT_EQ(unknown.fault, "cable");
  // run_process ends with the same exit code.
  EXPECT_EQ(statistics_after(std::system_error(ENOSPC, std::generic_category(), "write")).exit_code,
            ExitCode::bad_usage);
}

}  // namespace
}  // namespace tachless::session
