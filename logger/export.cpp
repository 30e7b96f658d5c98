#include "logger/export.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <initializer_list>
#include <string_view>
#include <system_error>
#include <utility>

#include "base/failure.h"
#include "base/file_text.h"
#include "base/json_text.h"
#include "base/text.h"
#include "logger/mcap.h"
#include "logger/table.h"
#include "logger/tick_messages.h"

namespace tachless::logger {
namespace {

constexpr std::size_t block_bytes = 1 << 18;

/// Table of comma-separated values. It appends to `-`, standard output, and overwrites a file.
class CsvTable {
 public:
  CsvTable(const std::filesystem::path& path, const std::vector<Quantity>& quantities,
           double period_s)
      : quantities_(quantities), period_s_(period_s) {
    file_ = path == "-" ? ::fdopen(::fcntl(STDOUT_FILENO, F_DUPFD_CLOEXEC, 0), "w")
                        : std::fopen(path.c_str(), "we");
    if (file_ == nullptr) fail(errno);
    block_ = "tick,t_s";
    for (const auto& quantity : quantities_) {
      for (std::size_t i = 0; i < quantity.units.size(); ++i) {
        block_.append(1, ',').append(base::csv_field(quantity.column(i)));
      }
    }
    block_ += '\n';
  }
  CsvTable(const CsvTable&) = delete;
  CsvTable& operator=(const CsvTable&) = delete;
  ~CsvTable() {
    if (file_ != nullptr) std::fclose(file_);
  }

  void append(const TickRecord& record) {
    if (block_.size() >= block_bytes) write();
    block_ += std::to_string(record.tick);
    add(static_cast<double>(record.tick) * period_s_);
    std::array<double, max_joints> values;
    for (const auto& quantity : quantities_) {
      const bool present = has(record, quantity.slot);
      if (present) quantity.read(record, values.data());
      for (std::size_t i = 0; i < quantity.units.size(); ++i) {
        if (present) {
          add(values[i]);
        } else {
          block_ += ',';
        }
      }
    }
    block_ += '\n';
  }

  void close() {
    write();
    if (std::fclose(std::exchange(file_, nullptr)) != 0) fail(errno);
  }

 private:
  void add(double value) {
    block_ += ',';
    add_number(block_, value);
  }

  void write() {
    if (std::fwrite(block_.data(), 1, block_.size(), file_) != block_.size()) fail(errno);
    block_.clear();
  }

  [[noreturn]] static void fail(int error) {
    throw std::system_error(error, std::generic_category());
  }

  const std::vector<Quantity>& quantities_;
  double period_s_;
  std::FILE* file_ = nullptr;
  std::string block_;  ///< rows that the next write takes
};

constexpr std::string_view joint_states = "foxglove.JointStates";
constexpr std::string_view joint_states_schema =
    R"({"title":"foxglove.JointStates","type":"object","properties":{)"
    R"("timestamp":{"type":"object","properties":{"sec":{"type":"integer"},"nsec":{"type":"integer"}}},)"
    R"("joints":{"type":"array","items":{"type":"object","properties":{"name":{"type":"string"},)"
    R"("position":{"type":"number"},"velocity":{"type":"number"},"acceleration":{"type":"number"},)"
    R"("effort":{"type":"number"}}}}}})";

/// Table as MCAP, which PlotJuggler and Foxglove read. Each kind of message has a channel of its
/// name. A message is a JSON object of its quantities, with their names in the CSV table. Two more
/// channels have the joints' true states and their reference as Foxglove's JointStates
/// (<ROBOT>_JOINT_STATES, …_REFERENCE).
class McapTable {
 public:
  McapTable(const std::filesystem::path& path, const std::vector<Quantity>& quantities,
            const RunLog& log)
      : file_(path),
        quantities_(quantities),
        period_ns_(1e9 * log.info().period_s),
        joints_(log.scenario().model->joint_names) {
    for (std::string& name : joints_) name = base::json_text(nlohmann::json(name));
    for (const Slot slot : messages::all_slots) {
      bool described_any = false;
      std::string properties = R"("tick":{"type":"integer"})";
      for (const Quantity& each : quantities_) {
        if (each.slot != slot) continue;
        described_any = true;
        const nlohmann::json described =
            fmt::format("{} [{}]", each.description, fmt::join(each.units, ", "));
        properties +=
            fmt::format(R"(,"{}":{{"type":"array","items":{{"type":"number"}},"description":{}}})",
                        each.name, base::json_text(described));
      }
      const std::string& topic = log.summary().of(slot).channel;
      if (topic.empty() || (may_be_absent(slot) && !described_any)) continue;
      channels_[index(slot)] =
          file_.add_channel(topic, fmt::format("tachless.{}", topic),
                            fmt::format(R"({{"type":"object","properties":{{{}}}}})", properties));
    }
    const std::string& robot = log.info().robot;
    states_ = file_.add_channel(robot + "_JOINT_STATES", joint_states, joint_states_schema);
    reference_ =
        file_.add_channel(robot + "_JOINT_STATES_REFERENCE", joint_states, joint_states_schema);
  }

  void append(const TickRecord& record) {
    const auto time_ns =
        static_cast<std::uint64_t>(std::llround(static_cast<double>(record.tick) * period_ns_));
    for (const Slot slot : messages::all_slots) {
      if (!has(record, slot)) continue;
      text_ = fmt::format(R"({{"tick":{})", record.tick);
      for (const Quantity& quantity : quantities_) {
        if (quantity.slot == slot) add(quantity, record);
      }
      file_.add(channels_[index(slot)], time_ns, text_ += "}");
    }
    if (const auto& truth = record.truth) {
      add_states(states_, time_ns,
                 {{"position", &truth->q}, {"velocity", &truth->v}, {"effort", &truth->tau}});
    }
    if (const auto& at = record.reference) {
      add_states(
          reference_, time_ns,
          {{"position", &at->q_ref}, {"velocity", &at->v_ref}, {"acceleration", &at->a_ref}});
    }
  }

  void close() { file_.close(); }

 private:
  void add(const Quantity& quantity, const TickRecord& record) {
    std::array<double, max_joints> values;
    quantity.read(record, values.data());
    text_ += fmt::format(R"(,"{}":)", quantity.name);
    for (std::size_t i = 0; i < quantity.units.size(); ++i) {
      text_ += i == 0 ? '[' : ',';
      add_number(text_, values[i]);
    }
    text_ += ']';
  }

  void add_states(std::uint16_t channel, std::uint64_t time_ns,
                  std::initializer_list<std::pair<std::string_view, const Vector*>> members) {
    text_ = fmt::format(R"({{"timestamp":{{"sec":{},"nsec":{}}},"joints":[)",
                        time_ns / 1'000'000'000, time_ns % 1'000'000'000);
    for (std::size_t i = 0; i < joints_.size(); ++i) {
      text_ += fmt::format(R"({}{{"name":{})", i == 0 ? "" : ",", joints_[i]);
      for (const auto& [name, values] : members) {
        text_ += fmt::format(R"(,"{}":)", name);
        add_number(text_, (*values)[static_cast<Eigen::Index>(i)]);
      }
      text_ += '}';
    }
    file_.add(channel, time_ns, text_ += "]}");
  }

  McapWriter file_;
  const std::vector<Quantity>& quantities_;
  double period_ns_;
  std::vector<std::string> joints_;  ///< names, as JSON
  std::array<std::uint16_t, messages::num_slots> channels_{};
  std::uint16_t states_ = 0, reference_ = 0;
  std::string text_;  ///< text of the current message
};

/// Removes the torques that the log's arm does not tell. Starts the log over.
void drop_untold(std::vector<Quantity>& quantities, RunLog& log) {
  log.rewind();
  if (!has_slot(log.scenario(), Slot::arm_torque)) return;
  TickRecord record;
  bool told = false;
  while (!told && log.next(record)) told = record.arm_torque.has_value();
  std::erase_if(quantities, [&](const Quantity& quantity) {
    if (!may_be_absent(quantity.slot)) return false;
    std::array<double, max_joints> values;
    if (told) quantity.read(record, values.data());
    return !told || std::isnan(values[0]);
  });
  log.rewind();
}

/// Writes a row for each tick into the file `to`.
void write_rows(const std::filesystem::path& to, bool mcap, const std::vector<Quantity>& quantities,
                RunLog& log) {
  const auto write = [&](auto&& table) {
    for (TickRecord record; log.next(record);) table.append(record);
    table.close();
  };
  if (mcap) {
    write(McapTable(to, quantities, log));
  } else {
    write(CsvTable(to, quantities, log.info().period_s));
  }
}

}  // namespace

std::string ExportResult::text() const {
  std::string text = fmt::format("{} ticks", summary.ticks);
  if (missing_values != 0) text += fmt::format(", {} values missing", missing_values);
  if (summary.ticks != 0) {
    for (const std::string& gap : summary.gap_texts()) text += "; " + gap;
  }
  if (damage.any()) text += "; the log is damaged: " + damage.text();
  return text;
}

ExportResult export_run(RunLog& log, const std::filesystem::path& path, bool force) {
  const bool mcap = path.extension() == ".mcap";
  if (path != "-" && !mcap && path.extension() != ".csv") {
    throw base::bad_usage(
        "{}: unknown kind of file; end its name in .csv or .mcap, or write the table to standard "
        "output by -",
        path.string());
  }
  auto quantities = quantities_of(log.scenario(), log.info());
  drop_untold(quantities, log);
  std::error_code error;
  if (path != "-" && !force && std::filesystem::is_regular_file(path, error)) {
    throw base::bad_usage("{}: exists already; name another file, or overwrite it with --force",
                          path.string());
  }
  try {
    if (path == "-") {
      write_rows(path, mcap, quantities, log);
    } else {
      base::UnfinishedFile unfinished(path, "name another file with -o");
      write_rows(unfinished.name(), mcap, quantities, log);
      unfinished.finish();
    }
  } catch (const std::system_error& problem) {
    throw base::bad_usage("{}: cannot write: {}; {}", path.string(), problem.code().message(),
                          problem.code() == std::errc::no_space_on_device
                              ? "free some space, or name a file on another disk"
                              : "name another file");
  }
  ExportResult result{log.summary(), log.damage()};
  for (const Quantity& quantity : quantities) {
    const std::uint64_t missing = result.summary.ticks - result.summary.of(quantity.slot).count;
    result.missing_values += missing * quantity.units.size();
  }
  return result;
}

}  // namespace tachless::logger
