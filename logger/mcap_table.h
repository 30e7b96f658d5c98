#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <initializer_list>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "logger/mcap.h"
#include "logger/run_log.h"
#include "logger/table.h"

namespace tachless::logger {

/// A run as MCAP, for PlotJuggler, Foxglove and the like: for each kind of message a channel of
/// that name with a JSON object of its quantities, called as in the table; and the joints' true
/// states and their reference as Foxglove's JointStates (<ROBOT>_JOINT_STATES, …_REFERENCE).
class McapTable {
 public:
  /// @param quantities outlives the table. @throw std::system_error as McapWriter; so do the others
  McapTable(const std::filesystem::path& path, const std::vector<Quantity>& quantities,
            const RunLog& log);

  void append(const TickRecord& record);
  void close() { file_.close(); }

 private:
  void add(const Quantity& quantity, const TickRecord& record);
  void add_states(std::uint16_t channel, std::uint64_t time_ns,
                  std::initializer_list<std::pair<std::string_view, const robot::Vector*>> members);

  McapWriter file_;
  const std::vector<Quantity>& quantities_;
  double period_ns_;
  std::vector<std::string> joints_;  ///< names, as JSON
  std::array<std::uint16_t, loop::num_slots> channels_{};
  std::uint16_t states_ = 0, reference_ = 0;
  std::string text_;  ///< of the message under way
};

}  // namespace tachless::logger
