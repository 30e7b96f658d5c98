#include "logger/export.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <cmath>
#include <csignal>
#include <cstdlib>
#include <sstream>

#include "base/failure.h"
#include "logger/table.h"
#include "tests/support/damaged_log.h"
#include "tests/support/recorded_run.h"
#include "tests/support/temporary_directory.h"

namespace tachless::logger {
namespace {

using testing::AllOf;
using testing::HasSubstr;

struct Table {
  std::vector<std::string> columns;
  std::vector<std::vector<std::string>> rows;

  [[nodiscard]] std::vector<std::string> column(const std::string& name) const {
    const auto at = std::find(columns.begin(), columns.end(), name) - columns.begin();
    std::vector<std::string> values;
    for (const auto& row : rows) values.push_back(row.at(static_cast<std::size_t>(at)));
    return values;
  }
};

std::vector<std::string> split(const std::string& line, char separator) {
  std::vector<std::string> cells{""};
  for (const char c : line) {
    if (c == separator) {
      cells.emplace_back();
    } else {
      cells.back() += c;
    }
  }
  return cells;
}

/// Changes the robot's URDF: each `before` becomes `after`.
void change_urdf(RecordedRun& recorded, const std::string& before, const std::string& after) {
  std::string urdf = recorded.scenario.robot.urdf_text;
  std::size_t at = urdf.find(before);
  ASSERT_NE(at, std::string::npos);
  for (; at != std::string::npos; at = urdf.find(before, at + after.size())) {
    urdf.replace(at, before.size(), after);
  }
  recorded.info.robot_description = urdf;
  messages::Codec<messages::RunInfo> codec(messages::Layout{1, 0, 0});
  const auto bytes = codec.encode(messages::Stamp{0, recorded.run, -1}, recorded.info);
  recorded.messages[0].data.assign(reinterpret_cast<const char*>(bytes.data()), bytes.size());
}

class Export : public testing::Test {
 protected:
  ExportResult run(const std::string& log_bytes, const std::filesystem::path& to,
                   bool force = false) {
    write_file(log_, log_bytes);
    auto log = RunLog::open(log_);
    return export_run(log, to, force);
  }

  Table table(const std::filesystem::path& path) {
    std::istringstream lines(read_file(path));
    Table result;
    std::string line;
    std::getline(lines, line);
    result.columns = split(line, ',');
    while (std::getline(lines, line)) {
      result.rows.push_back(split(line, ','));
      EXPECT_EQ(result.rows.back().size(), result.columns.size());
    }
    return result;
  }

  template <class Call>
  std::string failure_of(Call call) {
    try {
      call();
    } catch (const base::Failure& failure) {
      EXPECT_EQ(failure.code(), base::ExitCode::bad_usage);
      return failure.what();
    }
    return "no failure";
  }

  TemporaryDirectory directory_;
  std::filesystem::path log_ = directory_.path() / "lcmlog";
  std::filesystem::path csv_ = directory_.path() / "run.csv";
};

TEST_F(Export, RigidColumnsAreTheDocumentedOnes) {
  run(short_rigid_run().bytes(), csv_);
  EXPECT_EQ(testing::PrintToString(table(csv_).columns).empty(), false);
  const std::string header =
      "tick,t_s,q_shoulder_rad,q_elbow_rad,v_shoulder_rad_per_s,v_elbow_rad_per_s,q_ref_shoulder_"
      "rad,q_ref_elbow_rad,"
      "v_ref_shoulder_rad_per_s,v_ref_elbow_rad_per_s,a_ref_shoulder_rad_per_s2,a_ref_elbow_rad_"
      "per_s2,"
      "jerk_ref_shoulder_rad_per_s3,jerk_ref_elbow_rad_per_s3,snap_ref_shoulder_rad_per_s4,snap_"
      "ref_elbow_rad_per_s4,"
      "tau_shoulder_Nm,tau_elbow_Nm,error_shoulder_rad,error_elbow_rad,nu_shoulder_rad_per_s,nu_"
      "elbow_rad_per_s,"
      "q_measured_shoulder_rad,q_measured_elbow_rad,tau_applied_shoulder_Nm,tau_applied_elbow_Nm,"
      "saturated_shoulder,"
      "saturated_elbow,drive_fault\n";
  EXPECT_EQ(read_file(csv_).substr(0, header.size()), header);
}

TEST(ColumnNames, AreThoseOfJointsUnlessTwoColumnsWouldBeCalledTheSame) {
  using testing::ElementsAre;
  const std::vector<std::string> quantities = {"q", "q_ref"};
  EXPECT_THAT(joints_in_columns(quantities, {"a", "wrist 2"}), ElementsAre("a", "wrist 2"));
  EXPECT_THAT(joints_in_columns(quantities, {"a", "ref_a"}), ElementsAre("1", "2"));
  EXPECT_EQ(column_name("q_ref", "a", "rad"), "q_ref_a_rad");
  EXPECT_EQ(column_name("saturated", "a", "1"), "saturated_a");
  EXPECT_EQ(column_name("drive_fault", "", "1"), "drive_fault");
}

TEST_F(Export, CsvHoldsEveryNumberInFull) {
  const auto recorded = short_flexible_run();
  const auto result = run(recorded.bytes(), csv_);
  EXPECT_EQ(result.summary.ticks, 40u);
  EXPECT_EQ(result.missing_values, 0u);
  EXPECT_EQ(result.text(), "40 ticks");
  const auto csv = table(csv_);
  ASSERT_EQ(csv.rows.size(), 40u);
  const auto expect_column = [&](const std::string& name, auto value) {
    const auto cells = csv.column(name);
    for (std::size_t i = 0; i < cells.size(); ++i) {
      // A number in %.17g reads back as the same double.
      EXPECT_EQ(std::strtod(cells[i].c_str(), nullptr), value(recorded.ticks[i])) << name << i;
    }
  };
  using Tick = const TickRecord&;
  expect_column("tick", [](Tick t) { return static_cast<double>(t.tick); });
  expect_column("t_s", [&](Tick t) { return static_cast<double>(t.tick) * 1e-5; });
  expect_column("q_elbow_rad", [](Tick t) { return t.truth->q(1); });
  expect_column("theta_shoulder_rad", [](Tick t) { return t.truth->theta(0); });
  expect_column("thetadot_elbow_rad_per_s", [](Tick t) { return t.truth->thetadot(1); });
  expect_column("snap_ref_shoulder_rad_per_s4", [](Tick t) { return t.reference->snap_ref(0); });
  expect_column("tau_elbow_Nm", [](Tick t) { return t.command->tau(1); });
  expect_column("nu_1_shoulder_rad_per_s", [](Tick t) { return t.controller_state->value[1](0); });
  expect_column("nu_2_elbow_rad_per_s", [](Tick t) { return t.controller_state->value[3](1); });
  expect_column("error_2_shoulder_rad", [](Tick t) { return t.controller_state->value[2](0); });
  const auto measured = [](Tick t) {
    return std::get<messages::LinkStateMeasurement>(*t.measurement);
  };
  expect_column("q_measured_shoulder_rad", [&](Tick t) { return measured(t).q(0); });
  expect_column("v_measured_elbow_rad_per_s", [&](Tick t) { return measured(t).v(1); });
  expect_column("theta_measured_elbow_rad", [&](Tick t) { return measured(t).theta(1); });
  expect_column("tau_applied_shoulder_Nm", [](Tick t) { return t.truth->tau(0); });
  expect_column("saturated_shoulder", [](Tick t) { return t.truth->saturated[0] ? 1 : 0; });
  expect_column("drive_fault", [](Tick t) { return static_cast<double>(t.truth->fault); });
}

TEST_F(Export, AMissingPieceIsAnEmptyCellAndIsCounted) {
  auto recorded = short_rigid_run();
  std::erase_if(recorded.messages, [](const Recorded& message) {
    return (message.channel == "ARM_COMMAND" && message.utime == 150) ||
           message.channel == "ARM_TRUTH";
  });
  const auto result = run(recorded.bytes(), csv_);
  // Two torques; q, v, tau_applied, saturated (two each) and drive_fault at 40 ticks.
  EXPECT_EQ(result.missing_values, 2u + 40 * 9);
  EXPECT_THAT(result.text(),
              AllOf(HasSubstr("no ARM_TRUTH"), HasSubstr("ARM_COMMAND missing in 1 ticks")));
  const auto csv = table(csv_);
  EXPECT_EQ(csv.column("tau_shoulder_Nm")[3], "");
  EXPECT_NE(csv.column("tau_shoulder_Nm")[4], "");
  EXPECT_EQ(csv.column("q_shoulder_rad")[4], "");
  EXPECT_NE(csv.column("q_measured_shoulder_rad")[4], "");
}

TEST_F(Export, HasTheTorquesThatAnArmTold) {
  using messages::truth::Told;
  for (const auto told :
       {std::optional(Told::both), std::optional(Told::measured), std::optional<Told>()}) {
    const ExportResult result = run(short_arm_run(told).bytes(), csv_, true);
    const Table exported = table(csv_);
    const auto has = [&](const char* column) {
      return std::ranges::count(exported.columns, column) == 1;
    };
    EXPECT_EQ(has("tau_accepted_elbow_Nm"), told == Told::both);
    EXPECT_EQ(has("tau_measured_elbow_Nm"), told.has_value());
    if (told) {
      EXPECT_EQ(exported.column("tau_measured_elbow_Nm")[7], "7.5");
    }
    EXPECT_EQ(result.text(), "40 ticks") << "a torque that no arm tells is no gap";
    const auto mcap = directory_.path() / "run.mcap";
    run(short_arm_run(told).bytes(), mcap, true);
    EXPECT_EQ(read_file(mcap).find("ARM_ARM_TORQUE") != std::string::npos, told.has_value());
  }
}

TEST_F(Export, PrismaticJointsAreInMetresAndNewtons) {
  auto recorded = short_rigid_run();
  // The numbers are the same, but the robot's second joint slides.
  change_urdf(recorded, R"(<joint name="elbow" type="continuous">)",
              R"(<joint name="elbow" type="prismatic">
    <limit lower="-1" upper="1" effort="0" velocity="0"/>)");
  run(recorded.bytes(), csv_);
  EXPECT_THAT(table(csv_).columns,
              testing::IsSupersetOf({"q_shoulder_rad", "q_elbow_m", "v_elbow_m_per_s",
                                     "tau_elbow_N", "nu_elbow_m_per_s", "snap_ref_elbow_m_per_s4",
                                     "q_measured_elbow_m", "error_elbow_m"}));
}

TEST_F(Export, KeepsAnExistingFileUnlessForced) {
  const auto bytes = short_rigid_run().bytes();
  write_file(csv_, "precious");
  EXPECT_THAT(failure_of([&] { run(bytes, csv_); }),
              AllOf(HasSubstr(csv_.string()), HasSubstr("--force")));
  EXPECT_EQ(read_file(csv_), "precious");
  run(bytes, csv_, true);
  EXPECT_NE(read_file(csv_), "precious");
}

TEST_F(Export, RefusesWhatItCannotWrite) {
  const auto bytes = short_rigid_run().bytes();
  for (const auto* name : {"run.xls", "absent/run.csv"}) {
    EXPECT_THAT(failure_of([&] { run(bytes, directory_.path() / name); }), HasSubstr(name));
  }
}

TEST_F(Export, LeavesNothingBehindWhenTheDiskIsFull) {
  write_file(log_, recorded_run("paper_rigid.yaml", {"loop.duration_s=0.25"}, "POSITION").bytes());
  auto log = RunLog::open(log_);
  struct rlimit old {};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &old), 0);
  const auto old_handler = std::signal(SIGXFSZ, SIG_IGN);
  const rlimit small{200'000, old.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &small), 0);
  const auto failure = failure_of([&] { export_run(log, csv_); });
  setrlimit(RLIMIT_FSIZE, &old);
  std::signal(SIGXFSZ, old_handler);
  EXPECT_THAT(failure, HasSubstr("cannot write"));
  EXPECT_FALSE(std::filesystem::exists(csv_));
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(directory_.path()), {}), 1)
      << "beside the log";
}

TEST_F(Export, CsvGoesToAPipeAsItIs) {
  write_file(log_, short_rigid_run().bytes());
  auto log = RunLog::open(log_);
  const auto pipe = directory_.path() / "full.csv";
  std::filesystem::create_symlink("/dev/full", pipe);
  EXPECT_THAT(failure_of([&] { export_run(log, pipe, true); }), HasSubstr("No space left"));
}

}  // namespace
}  // namespace tachless::logger
