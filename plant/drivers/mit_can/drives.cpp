#include "plant/drivers/mit_can/drives.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <numbers>

#include "base/schema.h"

namespace tachless::mit_can {
namespace {

// RobStride: the type of a frame, in bits 24 to 28 of the identifier.
constexpr std::uint32_t operation = 1, status = 2, enabling = 3, disabling = 4, reading = 17,
                        writing = 18;
constexpr std::uint16_t measured_position = 0x7019;
// Damiao: questions and registers of all drives share an identifier.
constexpr std::uint32_t damiao_service = 0x7FF;
constexpr std::uint8_t damiao_read = 0x33, damiao_write = 0x55, damiao_ask = 0xCC;

/// Returns x as a share of [least, most] in `bits` bits, rounded to the nearest.
std::uint32_t coded(double x, double least, double most, int bits) {
  const double top = static_cast<double>((1U << bits) - 1);
  const double share = std::clamp((x - least) / (most - least), 0.0, 1.0);
  return static_cast<std::uint32_t>(std::lround(share * top));
}

double decoded(std::uint32_t x, double least, double most, int bits) {
  return static_cast<double>(x) / static_cast<double>((1U << bits) - 1) * (most - least) + least;
}

std::uint8_t byte(std::uint32_t bits) { return static_cast<std::uint8_t>(bits & 0xFFU); }
std::uint32_t word(const Frame& frame, std::size_t at) {
  return static_cast<std::uint32_t>(frame.data[at]) << 8U | frame.data[at + 1];
}
void put_word(Frame& frame, std::size_t at, std::uint32_t bits) {
  frame.data[at] = byte(bits >> 8U);
  frame.data[at + 1] = byte(bits);
}
void put_little(Frame& frame, std::size_t at, std::uint32_t bits, std::size_t bytes) {
  for (std::size_t i = 0; i < bytes; ++i) frame.data[at + i] = byte(bits >> (8 * i));
}
std::uint32_t little(const Frame& frame, std::size_t at) {
  std::uint32_t bits = 0;
  for (std::size_t i = 0; i < 4; ++i) bits |= std::uint32_t{frame.data[at + i]} << (8 * i);
  return bits;
}

Frame damiao_special(const Drive& drive, std::uint8_t what) {
  Frame frame{.id = static_cast<std::uint32_t>(drive.id)};
  frame.data.fill(0xFF);
  frame.data[7] = what;
  return frame;
}

Frame damiao_service_frame(const Drive& drive, std::uint8_t what, std::uint8_t which,
                           std::uint32_t bits) {
  Frame frame{.id = damiao_service};
  put_little(frame, 0, static_cast<std::uint32_t>(drive.id), 2);
  frame.data[2] = what;
  frame.data[3] = which;
  put_little(frame, 4, bits, 4);
  return frame;
}

Frame robstride_frame(std::uint32_t type, std::uint32_t middle, int id) {
  return {.id = type << 24U | middle << 8U | static_cast<std::uint32_t>(id), .extended = true};
}

Frame robstride_register(const Drive& drive, std::uint32_t type, std::uint16_t address,
                         std::uint32_t bits) {
  Frame frame = robstride_frame(type, static_cast<std::uint32_t>(drive.reply_id), drive.id);
  put_little(frame, 0, address, 2);
  put_little(frame, 4, bits, 4);
  return frame;
}

std::uint8_t damiao_address(Register which) {
  switch (which) {
    case Register::mode:
      return 10;
    case Register::watchdog:
      return 9;
    case Register::q_range:
      return 21;
    case Register::v_range:
      return 22;
    case Register::tau_range:
      break;
  }
  return 23;
}

std::uint16_t robstride_address(Register which) {
  return which == Register::mode ? 0x7005 : 0x7028;  // its ranges are in no register
}

/// Returns the answer of a RobStride drive to a command, or to a question for its position.
std::optional<Answer> robstride_answer(const Drive& drive, const Frame& frame) {
  const std::uint32_t type = frame.id >> 24U;
  const bool own = frame.extended && (frame.id >> 8U & 0xFFU) == std::uint32_t(drive.id) &&
                   (frame.id & 0xFFU) == std::uint32_t(drive.reply_id);
  if (!own || frame.length < 8) return std::nullopt;
  const Ranges& r = drive.ranges;
  Answer answer;
  if (type == reading && (frame.data[0] | frame.data[1] << 8) == measured_position) {
    answer.q = static_cast<double>(std::bit_cast<float>(little(frame, 4)));
    return std::isfinite(answer.q) ? std::optional(answer) : std::nullopt;
  }
  if (type != status) return std::nullopt;
  answer.q = decoded(word(frame, 0), -r.q, r.q, 16);
  answer.v = decoded(word(frame, 2), -r.v, r.v, 16);
  answer.tau = decoded(word(frame, 4), -r.tau, r.tau, 16);
  answer.temperature = 0.1 * word(frame, 6);
  answer.fault = static_cast<int>(frame.id >> 16U & 0x3FU);
  answer.enabled = (frame.id >> 22U & 3U) == 2;
  return answer;
}

}  // namespace

Family family_of(Model model) {
  const bool damiao = base::name_of(model).starts_with("d");
  return damiao ? Family::damiao : Family::robstride;
}

Ranges ranges_of(Model model) {
  const auto damiao = [](double v, double tau) { return Ranges{12.5, v, tau}; };
  const auto small = [](double v, double tau) { return Ranges{4 * std::numbers::pi, v, tau}; };
  const auto large = [](double v, double tau) {
    return Ranges{4 * std::numbers::pi, v, tau, 5000, 100};
  };
  switch (model) {
    case Model::damiao:
    case Model::robstride:
      return {};
    case Model::dm3507:
      return damiao(50, 5);
    case Model::dm4310:
      return damiao(30, 10);
    case Model::dm4310_48v:
      return damiao(50, 10);
    case Model::dm4340:
      return damiao(10, 28);
    case Model::dm6006:
      return damiao(45, 20);
    case Model::dm8006:
      return damiao(45, 40);
    case Model::dm8009:
      return damiao(45, 54);
    case Model::dm10010l:
      return damiao(25, 200);
    case Model::dm10010:
      return damiao(20, 200);
    case Model::rs00:
      return small(50, 17);
    case Model::rs01:
    case Model::rs02:
      return small(44, 17);
    case Model::rs03:
      return large(50, 60);
    case Model::rs04:
      return large(15, 120);
    case Model::rs05:
      return small(33, 17);
    case Model::rs06:
      return large(20, 60);
    case Model::cybergear:
      break;
  }
  return small(30, 12);
}

Frame enable(const Drive& drive) {
  if (drive.family == Family::damiao) return damiao_special(drive, 0xFC);
  return robstride_frame(enabling, static_cast<std::uint32_t>(drive.reply_id), drive.id);
}

Frame disable(const Drive& drive) {
  if (drive.family == Family::damiao) return damiao_special(drive, 0xFD);
  return robstride_frame(disabling, static_cast<std::uint32_t>(drive.reply_id), drive.id);
}

Frame clear_fault(const Drive& drive) {
  if (drive.family == Family::damiao) return damiao_special(drive, 0xFB);
  Frame frame = disable(drive);
  frame.data[0] = 1;
  return frame;
}

Frame ask(const Drive& drive) {
  if (drive.family == Family::damiao) return damiao_service_frame(drive, damiao_ask, 0, 0);
  return robstride_register(drive, reading, measured_position, 0);
}

Frame command(const Drive& drive, const Setpoint& set) {
  const Ranges& r = drive.ranges;
  if (drive.family == Family::robstride) {
    Frame frame = robstride_frame(operation, coded(set.tau, -r.tau, r.tau, 16), drive.id);
    put_word(frame, 0, coded(set.q, -r.q, r.q, 16));
    put_word(frame, 2, coded(set.v, -r.v, r.v, 16));
    put_word(frame, 4, coded(set.kp, 0, r.kp, 16));
    put_word(frame, 6, coded(set.kd, 0, r.kd, 16));
    return frame;
  }
  const std::uint32_t v = coded(set.v, -r.v, r.v, 12), kp = coded(set.kp, 0, r.kp, 12),
                      kd = coded(set.kd, 0, r.kd, 12), tau = coded(set.tau, -r.tau, r.tau, 12);
  Frame frame{.id = static_cast<std::uint32_t>(drive.id)};
  put_word(frame, 0, coded(set.q, -r.q, r.q, 16));
  frame.data[2] = byte(v >> 4U);
  frame.data[3] = byte((v & 15U) << 4U | kp >> 8U);
  frame.data[4] = byte(kp);
  frame.data[5] = byte(kd >> 4U);
  frame.data[6] = byte((kd & 15U) << 4U | tau >> 8U);
  frame.data[7] = byte(tau);
  return frame;
}

Frame command(const Drive& drive, Setpoint setpoint, double& rest) {
  const Setpoint coarse = *setpoint_in(drive, command(drive, setpoint));
  const double lost = coarse.kp * (setpoint.q - coarse.q) + coarse.kd * (setpoint.v - coarse.v);
  setpoint.tau = std::clamp(setpoint.tau + lost, -drive.ranges.tau, drive.ranges.tau) + rest;
  const Frame frame = command(drive, setpoint);
  rest = setpoint.tau - setpoint_in(drive, frame)->tau;
  return frame;
}

std::optional<Setpoint> setpoint_in(const Drive& drive, const Frame& frame) {
  const Ranges& r = drive.ranges;
  const auto& d = frame.data;
  if (frame.length < 8) return std::nullopt;
  Setpoint set;
  if (drive.family == Family::robstride) {
    if (!frame.extended || frame.id >> 24U != operation ||
        (frame.id & 0xFFU) != std::uint32_t(drive.id))
      return std::nullopt;
    set.q = decoded(word(frame, 0), -r.q, r.q, 16);
    set.v = decoded(word(frame, 2), -r.v, r.v, 16);
    set.kp = decoded(word(frame, 4), 0, r.kp, 16);
    set.kd = decoded(word(frame, 6), 0, r.kd, 16);
    set.tau = decoded(frame.id >> 8U & 0xFFFFU, -r.tau, r.tau, 16);
    return set;
  }
  if (frame.extended || frame.id != std::uint32_t(drive.id)) return std::nullopt;
  const bool special = d[7] >= 0xFB && std::all_of(d.begin(), d.end() - 1,
                                                   [](std::uint8_t each) { return each == 0xFF; });
  if (special) return std::nullopt;
  set.q = decoded(word(frame, 0), -r.q, r.q, 16);
  set.v = decoded(word(frame, 2) >> 4U, -r.v, r.v, 12);
  set.kp = decoded(word(frame, 3) & 0xFFFU, 0, r.kp, 12);
  set.kd = decoded(word(frame, 5) >> 4U, 0, r.kd, 12);
  set.tau = decoded(word(frame, 6) & 0xFFFU, -r.tau, r.tau, 12);
  return set;
}

std::optional<Answer> answer_in(const Drive& drive, const Frame& frame) {
  if (drive.family == Family::robstride) return robstride_answer(drive, frame);
  const auto& d = frame.data;
  if (frame.extended || frame.id != std::uint32_t(drive.reply_id) || frame.length < 8 ||
      (d[0] & 15) != (drive.id & 15)) {
    return std::nullopt;
  }
  const Ranges& r = drive.ranges;
  Answer answer;
  answer.q = decoded(word(frame, 1), -r.q, r.q, 16);
  answer.v = decoded(word(frame, 3) >> 4U, -r.v, r.v, 12);
  answer.tau = decoded(word(frame, 4) & 0xFFFU, -r.tau, r.tau, 12);
  answer.temperature = std::max(d[6], d[7]);
  const int state = d[0] >> 4;
  answer.enabled = state == 1;
  answer.fault = state > 1 ? state : 0;
  return answer;
}

Frame answer_frame(const Drive& drive, const Answer& answer) {
  const Ranges& r = drive.ranges;
  if (drive.family == Family::robstride) {
    const std::uint32_t flags =
        static_cast<std::uint32_t>(answer.fault) << 8U | (answer.enabled ? 2U : 0U) << 14U;
    Frame frame =
        robstride_frame(status, flags | static_cast<std::uint32_t>(drive.id), drive.reply_id);
    put_word(frame, 0, coded(answer.q, -r.q, r.q, 16));
    put_word(frame, 2, coded(answer.v, -r.v, r.v, 16));
    put_word(frame, 4, coded(answer.tau, -r.tau, r.tau, 16));
    put_word(frame, 6, static_cast<std::uint32_t>(std::lround(10 * answer.temperature)));
    return frame;
  }
  Frame frame{.id = static_cast<std::uint32_t>(drive.reply_id)};
  const int state = answer.fault != 0 ? answer.fault : answer.enabled ? 1 : 0;
  const std::uint32_t v = coded(answer.v, -r.v, r.v, 12),
                      tau = coded(answer.tau, -r.tau, r.tau, 12);
  frame.data[0] = byte(static_cast<std::uint32_t>(state << 4 | (drive.id & 15)));
  put_word(frame, 1, coded(answer.q, -r.q, r.q, 16));
  frame.data[3] = byte(v >> 4U);
  frame.data[4] = byte((v & 15U) << 4U | tau >> 8U);
  frame.data[5] = byte(tau);
  frame.data[6] = frame.data[7] = byte(static_cast<std::uint32_t>(std::lround(answer.temperature)));
  return frame;
}

std::string fault_text(Family family, int fault) {
  if (family == Family::damiao) {
    switch (fault) {
      case 0x8:
        return "over-voltage";
      case 0x9:
        return "under-voltage";
      case 0xA:
        return "over-current";
      case 0xB:
        return "its transistors are too hot";
      case 0xC:
        return "its coils are too hot";
      case 0xD:
        return "it had no command in time (its watchdog)";
      case 0xE:
        return "overload";
      default:
        return fmt::format("code {:X}, see its manual", fault);
    }
  }
  constexpr std::array<std::string_view, 6> bits = {
      "under-voltage",        "over-current",          "too hot",
      "its magnetic encoder", "stalled or overloaded", "not calibrated"};
  std::string text;
  for (std::size_t i = 0; i < bits.size(); ++i) {
    if ((fault >> i & 1) != 0) text += (text.empty() ? "" : ", ") + std::string(bits[i]);
  }
  return text;
}

std::uint32_t watchdog_bits(double seconds) {
  return static_cast<std::uint32_t>(std::lround(20000 * seconds));
}

Frame read_register(const Drive& drive, Register which) {
  if (drive.family == Family::damiao) {
    return damiao_service_frame(drive, damiao_read, damiao_address(which), 0);
  }
  return robstride_register(drive, reading, robstride_address(which), 0);
}

Frame write_register(const Drive& drive, Register which, std::uint32_t bits) {
  if (drive.family == Family::damiao) {
    return damiao_service_frame(drive, damiao_write, damiao_address(which), bits);
  }
  return robstride_register(drive, writing, robstride_address(which), bits);
}

std::optional<std::uint32_t> register_in(const Drive& drive, Register which, const Frame& frame) {
  const auto& d = frame.data;
  if (frame.length < 8) return std::nullopt;
  if (drive.family == Family::damiao) {
    const bool own = !frame.extended && frame.id == std::uint32_t(drive.reply_id) &&
                     (d[0] | d[1] << 8) == drive.id && d[2] == damiao_read &&
                     d[3] == damiao_address(which);
    return own ? std::optional(little(frame, 4)) : std::nullopt;
  }
  const bool own = frame.extended && frame.id >> 24U == reading &&
                   (frame.id >> 8U & 0xFFU) == std::uint32_t(drive.id) &&
                   (d[0] | d[1] << 8) == robstride_address(which);
  return own ? std::optional(little(frame, 4)) : std::nullopt;
}

}  // namespace tachless::mit_can
