#include "plant/drivers/mit_can/scan.h"

#include <fmt/format.h>

#include <bit>
#include <optional>
#include <ostream>

#include "plant/drivers/mit_can/can_bus.h"
#include "plant/drivers/mit_can/drives.h"

namespace tachless::mit_can {
namespace {

using base::Clock;
using std::chrono::milliseconds;

constexpr int host = 253;

/// Returns a number of the drive's register of a float; nothing without an answer.
std::optional<double> number_in(CanBus& bus, const Drive& drive, Register which,
                                milliseconds answer_time) {
  bus.send(read_register(drive, which));
  const auto until = Clock::now() + answer_time;
  while (const auto frame = bus.receive(until)) {
    if (const auto bits = register_in(drive, which, *frame)) {
      return static_cast<double>(std::bit_cast<float>(*bits));
    }
  }
  return std::nullopt;
}

std::string state_text(const Answer& answer, Family family) {
  if (answer.fault != 0) return "fault: " + fault_text(family, answer.fault);
  return answer.enabled ? "enabled" : "disabled";
}

bool print_damiao(CanBus& bus, int id, milliseconds answer_time, std::ostream& to) {
  Drive drive{Family::damiao, id, 0, {12.5, 30, 10}};
  bus.send(ask(drive));
  const auto until = Clock::now() + answer_time;
  while (const auto frame = bus.receive(until)) {
    drive.reply_id = static_cast<int>(frame->id);
    if (frame->extended || frame->id == 0x7FF || frame->id == static_cast<std::uint32_t>(id) ||
        !answer_in(drive, *frame)) {
      continue;
    }
    const Answer before = *answer_in(drive, *frame);
    // Only a disabled drive's registers can be told from its states.
    std::string ranges;
    if (!before.enabled) {
      const auto q = number_in(bus, drive, Register::q_range, answer_time),
                 v = number_in(bus, drive, Register::v_range, answer_time),
                 tau = number_in(bus, drive, Register::tau_range, answer_time);
      if (q && v && tau) {
        drive.ranges = {*q, *v, *tau};
        ranges = fmt::format(", ranges {:.6g} rad, {:.6g} rad/s, {:.6g} N m, at {:.4f} rad", *q, *v,
                             *tau, answer_in(drive, *frame)->q);
      }
    }
    to << fmt::format("damiao     id {}, answers on {}, {}{}\n", id, drive.reply_id,
                      state_text(before, Family::damiao), ranges);
    return true;
  }
  return false;
}

bool print_robstride(CanBus& bus, int id, milliseconds answer_time, std::ostream& to) {
  const Drive drive{Family::robstride, id, host, ranges_of(Model::rs00)};
  bus.send(ask(drive));
  const auto until = Clock::now() + answer_time;
  while (const auto frame = bus.receive(until)) {
    const auto answer = answer_in(drive, *frame);
    if (!answer) continue;
    to << fmt::format("robstride  id {}, answers to host {}, at {:.4f} rad\n", id, host, answer->q);
    return true;
  }
  return false;
}

}  // namespace

int scan(const std::string& name, bool fd, std::ostream& to, const ScanRange& range) {
  CanBus bus(name, fd);
  int found = 0;
  for (int id = 1; id <= range.last_damiao; ++id) {
    found += print_damiao(bus, id, range.answer_time, to) ? 1 : 0;
  }
  for (int id = 1; id <= range.last_robstride; ++id) {
    found += print_robstride(bus, id, range.answer_time, to) ? 1 : 0;
  }
  return found;
}

}  // namespace tachless::mit_can
