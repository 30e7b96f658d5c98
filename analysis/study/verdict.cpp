#include "study/verdict.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <variant>

#include "scenario/largest_friction.h"

namespace tachless::study {
namespace {

// Four quarters of ten samples: fewer show no swing.
constexpr std::int64_t fewest_ticks = 40;
// Share of the scale. Control engineers call a response settled within 1 or 2 %.
constexpr double converged_share = 0.01;
// Share of the scale up to which a growing error may be an early part of a slow motion's lag.
constexpr double small_share = 0.05;
// Encoder counts that no error has to be below: a law cannot see less than one, and rounding adds
// up over a position and its difference.
constexpr double counts = 3;
// Counts that a loop makes into larger swings, of another size in each quarter: up to 11 seen.
constexpr double swing_counts = 10;
// Standard deviations of the noise's error. A Gaussian sample is beyond them in one of 2 million.
constexpr double deviations = 5;
// [rad; m] Rounding of a run without an encoder; a count of 22 bits is 1.5e-6.
constexpr double least = 1e-6;
// [rad; m] No swing below is called an oscillation, nor in real time a growth: late commands make
// swings too.
constexpr double small = 1e-3;
// Share of an error that a joint at rest may move: friction leaves only the integrator's drift.
constexpr double still = 1e-3;
// Share of an error by which a constant one may change; a decay by e takes then 20 quarters.
constexpr double constant = 0.05;
// Shares of the reference's travel and mean speed below which dry friction holds a joint.
constexpr double hardly = 0.2, at_rest = 0.01;
constexpr double rests_for = 0.25;  // share of the time that a slipping joint stands still
// Share of the largest scale below which a joint only holds its place against the others' motion.
constexpr double holds = 1e-3;
// Share by which two periods of a forced response may differ. A growth by e in 20 periods passes;
// one that fast is beyond the scale within a run.
constexpr double alike = 0.05;

struct Span {
  double low = INFINITY, high = -INFINITY;
  [[nodiscard]] double extent() const { return std::max(0.0, high - low); }
  [[nodiscard]] double peak() const { return low > high ? 0 : std::max(std::abs(low), high); }
};

Span span(const std::vector<Point>& points, double from, double to) {
  Span result;
  for (const Point& point : points) {
    if (point.x < from || point.x > to) continue;
    result.low = std::min(result.low, point.y);
    result.high = std::max(result.high, point.y);
  }
  return result;
}

/// How often a curve turns and goes back by more than `amplitude`.
int turns(const std::vector<Point>& points, double from, double to, double amplitude) {
  int result = 0, direction = 0;
  Span before;  // the first one
  double extreme = 0;
  for (const auto& [x, y] : points) {
    if (x < from || x > to) continue;
    before.low = std::min(before.low, y);
    before.high = std::max(before.high, y);
    if (direction == 0) {
      if (y - before.low > amplitude) direction = 1;
      if (before.high - y > amplitude) direction = -1;
      extreme = y;
    } else if ((y - extreme) * direction > 0) {
      extreme = y;
    } else if ((extreme - y) * direction > amplitude) {
      ++result;
      direction = -direction;
      extreme = y;
    }
  }
  return result;
}

/// The sum of f(time, way up or down) over the steps of a curve.
template <class F>
double sum_of_steps(const std::vector<Point>& points, double from, double to, F f) {
  double result = 0;
  for (std::size_t i = 1; i < points.size(); ++i) {
    if (points[i - 1].x < from || points[i].x > to) continue;
    result += f(points[i].x - points[i - 1].x, std::abs(points[i].y - points[i - 1].y));
  }
  return result;
}

/// A joint's value of a vector that may be empty.
double entry(const Vector& values, std::size_t joint) {
  return values.size() == 0 ? 0 : values[static_cast<Eigen::Index>(joint)];
}

/// Facts that all joints share.
struct Context {
  bool rests = false;      ///< no reference moves and no disturbance varies in the last quarter
  bool disturbed = false;  ///< a disturbance varies in the last quarter
  bool saturates = false;  ///< a joint was at its torque limit
  double rested_s = 0;     ///< time from the end of all motion to the end of the run
  double period_s = 0;     ///< of the reference
  LoopYardstick loop{};

  /// Returns true if the run, from the end of all motion on, is shorter than the loop's settling.
  [[nodiscard]] bool unsettled() const { return loop.stable && rested_s < loop.settling_s; }
};

/// A joint's run in the numbers that decide.
struct Joint {
  std::vector<Point> error, q, q_ref;
  double end, quarter, own_scale, noise, smallest_swing, friction;
  double deviation = 0;  ///< of the error by the encoders' noise, in the linear loop
  double scale = 0;
  Outcome outcome = Outcome::converged;
  Cause cause = Cause::unknown;
  std::array<Span, 4> in;  ///< the error in each quarter
  Span last, position;     ///< the error in the last quarter; q in it
  int fast;                ///< turns in the last quarter, by half of the error's extent

  Joint(const JointTracking& joint, double resolution, double friction_Nm, bool realtime)
      : error(joint.error_over_time.points()),
        q(joint.q.points()),
        q_ref(joint.q_ref.points()),
        end(error.back().x),
        quarter(end / 4),
        own_scale(std::max(span(q_ref, 0, end).extent(), std::abs(joint.error.first()))),
        noise(std::max(counts * resolution, least)),
        smallest_swing(std::max(swing_counts * resolution, realtime ? small : least)),
        friction(friction_Nm),
        in{in_quarter(error, 0), in_quarter(error, 1), in_quarter(error, 2), in_quarter(error, 3)},
        last(in[3]),
        position(in_quarter(q, 3)),
        fast(turns(error, 3 * quarter, end, 0.99 * last.extent() / 2)) {}

  [[nodiscard]] Span in_quarter(const std::vector<Point>& points, int i) const {
    return span(points, i * quarter, (i + 1) * quarter);
  }
  [[nodiscard]] double by_noise() const { return deviations * deviation; }
  [[nodiscard]] double allowed(double share) const {
    return std::max(share * scale, noise) + by_noise();
  }
  [[nodiscard]] bool within(double share) const { return last.peak() <= allowed(share); }
  [[nodiscard]] int turns_in(const std::vector<Point>& points, int i, double amplitude) const {
    return turns(points, i * quarter, (i + 1) * quarter, amplitude);
  }
  /// Returns how often the reference turns in a quarter.
  [[nodiscard]] int asked(int i) const {
    return turns_in(q_ref, i, 0.1 * span(q_ref, 0, end).extent());
  }
  /// Returns how often an error turns in a quarter, at least, if the reference does not make it.
  [[nodiscard]] int unasked(int i) const { return std::max(6, 3 * (asked(i) + 1) + 1); }

  /// Returns the size of the swings in a quarter that the reference does not make: by how much the
  /// error goes back that often. A slow error on which they ride is not in it. 0: noise.
  [[nodiscard]] double swing(int i) const {
    const int often = unasked(i);
    double low = std::max(smallest_swing, 2 * by_noise());
    double high = in[static_cast<std::size_t>(i)].extent();
    if (turns_in(error, i, low) < often) return 0;
    constexpr double precision = 1.005;
    for (int step = 0; step < 40 && high > precision * low; ++step) {
      const double middle = std::sqrt(low) * std::sqrt(high);
      (turns_in(error, i, middle) < often ? high : low) = middle;
    }
    return low;
  }
  /// Returns true if its swings grow from quarter to quarter, however small they are.
  [[nodiscard]] bool swings_grow() const {
    constexpr double growth = 1.3;  // swings of constant size differ by less with ten turns
    const double now = swing(3), before = now > 0 ? swing(2) : 0;
    if (before == 0 || now <= growth * before) return false;
    const double first = swing(1);
    return first > 0 && before > growth * first;
  }
  /// Returns true if the error of the reference's last period is that of the period before: in
  /// each eighth of it. A swing that is faster than the reference does not repeat.
  [[nodiscard]] bool repeats(double period_s) const {
    if (period_s <= 0 || 2 * period_s > end) return false;
    // Inertia and gravity make errors of twice the reference's frequency, not faster ones.
    if (fast > 2 * (asked(3) + 1)) return false;
    const double extent = span(error, end - period_s, end).extent();
    // A curve's points are so far apart; a sine changes by up to pi extents in a period.
    const double apart = end / (static_cast<double>(error.size()) / 2);
    const double by_points = std::numbers::pi * apart / period_s;
    const double allowed = std::max((alike + by_points) * extent, noise + 2 * by_noise());
    constexpr int parts = 8;
    for (int part = 0; part < parts; ++part) {
      const double from = end - period_s * (1 - static_cast<double>(part) / parts);
      const Span now = span(error, from, from + period_s / parts);
      const Span before = span(error, from - period_s, from - period_s + period_s / parts);
      if (std::abs(now.low - before.low) > allowed || std::abs(now.high - before.high) > allowed) {
        return false;
      }
    }
    return true;
  }
  /// Returns true if the reference makes the error, however large it is.
  [[nodiscard]] bool forced(const Context& context) const {
    if (repeats(context.period_s)) return true;
    return !context.rests && context.loop.stable && !context.saturates;
  }
  [[nodiscard]] bool diverges(const Context& context) const {
    if (swings_grow()) return true;
    const double first_half = std::max(in[0].peak(), in[1].peak());
    constexpr double growth = 4;  // an error's quarters on a motion differ by less
    if (within(small_share) || last.peak() <= growth * first_half + by_noise()) return false;
    if (repeats(context.period_s) || (context.unsettled() && last.peak() <= scale)) return false;
    const double asked_before = span(q_ref, 0, 2 * quarter).extent();
    return last.peak() > scale || in_quarter(q_ref, 3).extent() <= asked_before;
  }
  [[nodiscard]] bool swings() const {
    constexpr double kept = 0.8;  // a decay by less takes more than a run to be seen
    return last.extent() / 2 > std::max({small, noise, by_noise()}) &&
           last.extent() >= kept * in[2].extent() && fast >= unasked(3);
  }
  /// Returns true if dry friction holds it, though its reference may go on.
  [[nodiscard]] bool sticks() const {
    if (position.extent() <= still * last.peak() + 2 * by_noise()) return true;
    const double way = sum_of_steps(q_ref, 3 * quarter, end, [](double, double up) { return up; });
    const double speed = at_rest * way / quarter;
    const auto slow = [&](double time, double up) { return up <= speed * time ? time : 0; };
    return position.extent() <= hardly * in_quarter(q_ref, 3).extent() &&
           sum_of_steps(q, 3 * quarter, end, slow) >= rests_for * quarter;
  }
  /// Returns true if the error still falls nearly as fast as in the quarter before, or if the loop
  /// has not had the time in which it settles.
  [[nodiscard]] bool still_settles(const Context& context) const {
    if (context.unsettled()) return true;
    const double before = in[2].extent(), fall = in[2].peak() - last.peak();
    const double moving = 0.5 * std::min(before, last.peak());
    return fall > 0.9 * before && last.extent() > std::max(noise + 2 * by_noise(), moving);
  }
  void found(Outcome word, Cause why = Cause::unknown) {
    outcome = word;
    cause = why;
  }
  /// Judges an error at rest: its mean apart from the swings about it.
  void judge_at_rest(const Context& context) {
    const double middle = std::abs(last.low + last.high) / 2, half = last.extent() / 2;
    if (still_settles(context)) return found(Outcome::lags, Cause::settling);
    const bool falls = last.peak() < 0.95 * in[2].peak() && last.extent() < 0.95 * in[2].extent();
    if (falls && half > by_noise() && middle < half) return found(Outcome::lags, Cause::settling);
    const bool beside = middle > std::max(converged_share * scale, noise) + by_noise();
    if (beside || half <= std::max(noise, by_noise())) return found(Outcome::rests_beside);
    // Nothing but the loop itself makes a swing at rest.
    found(half > small ? Outcome::oscillates : Outcome::lags);
  }
  void judge(const Context& context) {
    if (diverges(context)) return found(Outcome::diverging);
    if (swings()) return found(Outcome::oscillates);
    if (within(converged_share)) return found(Outcome::converged);
    if (friction > 0 && !within(small_share) && sticks())
      return found(Outcome::rests_beside, Cause::friction);
    if (context.rests && context.rested_s > 0) return judge_at_rest(context);
    // On a motion that is slower than the run an error is nearly constant too.
    if (last.extent() < constant * last.peak() && position.extent() < last.peak()) {
      return still_settles(context) ? found(Outcome::lags, Cause::settling)
                                    : found(Outcome::rests_beside);
    }
    const bool had_time = context.loop.stable && !context.unsettled();
    const bool settles = !had_time && (!within(1) || last.peak() < 0.95 * in[2].peak());
    found(Outcome::lags, settles             ? Cause::settling
                         : context.disturbed ? Cause::disturbance
                                             : Cause::motion);
  }
  /// Judges an error beyond the scale, which neither its start nor its own motion explains, unless
  /// it falls or the motion of all joints forces it.
  void judge_by_scale(const Context& context) {
    constexpr double less = 0.995;  // an undamped swing's peaks differ by less
    const double before = in[2].peak(), now = last.peak();
    const bool falls = now < less * before && before < less * in[1].peak() && now < in[0].peak();
    if (within(1) || falls) return;
    if (forced(context)) return found(Outcome::lags, Cause::motion);
    if (now > 1.25 * before) return found(Outcome::diverging);
    if (last.low > 0 || last.high < 0) return found(Outcome::rests_beside);
    found(fast > 1 ? Outcome::oscillates : Outcome::diverging);
  }
  /// Returns when the error was last beyond 1 % of the scale.
  [[nodiscard]] double above_s() const {
    double above = 0;
    for (const Point& point : error) {
      if (std::abs(point.y) > allowed(converged_share)) above = point.x;
    }
    return above;
  }
};

void set_scales(std::vector<Joint>& joints) {
  double largest = 0;
  for (const Joint& joint : joints) largest = std::max(largest, joint.own_scale);
  for (Joint& joint : joints) {
    const double whole = span(joint.error, 0, joint.end).peak();
    const bool moves = joint.own_scale > std::max(joint.noise, holds * largest);
    joint.scale = moves ? joint.own_scale : largest > 0 ? largest : whole;
  }
}

/// Takes the worst joint's facts; of equally bad ones those with the largest share of the scale.
void judge_worst(const std::vector<Joint>& joints, const Yardsticks& yardsticks, Verdict& result) {
  result.outcome = Outcome::converged;
  double worst = -1;
  for (std::size_t i = 0; i < joints.size(); ++i) {
    const Joint& joint = joints[i];
    const double share = joint.last.peak() / joint.scale;
    const double badness = std::isfinite(share) ? share : 0;
    const bool worse =
        joint.outcome > result.outcome || (joint.outcome == result.outcome && badness > worst);
    if (!worse) continue;
    worst = badness;
    result.outcome = joint.outcome;
    result.cause = joint.cause;
    result.joint = i;
    result.error = joint.last.peak();
    result.share = share;
    result.frequency_hz = joint.fast / (2 * joint.quarter);
    result.friction = joint.friction;
    result.stiffness = entry(yardsticks.stiffness, i);
  }
}

/// Returns what holds a joint beside its reference.
std::string held_text(const Verdict& verdict, std::string_view length, std::string_view effort) {
  if (verdict.stiffness <= 0) return "";
  const double reach = verdict.friction / verdict.stiffness;
  if (verdict.cause == Cause::friction && verdict.error <= 1.05 * reach) {
    return fmt::format("; dry friction of {:.3g} {} holds it up to F_c/kp = {:.2g} {}",
                       verdict.friction, effort, reach, length);
  }
  return fmt::format(
      "; d/kp: a torque of about {:.2g} {} that the law does not know, over kp = {:.3g}",
      verdict.error * verdict.stiffness, effort, verdict.stiffness);
}

/// Returns the period in which sinusoids of these frequencies repeat, if all are multiples of the
/// lowest; else 0.
double common_period_s(const std::vector<reference::trajectory::Sine>& sines) {
  std::vector<double> all;
  for (const auto& sine : sines) {
    for (Eigen::Index i = 0; i < sine.frequency_hz.size(); ++i) {
      if (sine.amplitude_rad[i] != 0 && sine.frequency_hz[i] > 0) {
        all.push_back(sine.frequency_hz[i]);
      }
    }
  }
  if (all.empty()) return 0;
  const double lowest = std::ranges::min(all);
  const auto multiple = [&](double f) {
    return std::abs(f / lowest - std::round(f / lowest)) < 1e-9;  // decimals' rounding
  };
  return std::ranges::all_of(all, multiple) ? 1 / lowest : 0;
}

/// Returns true if a disturbance begins, ends or swings between the two times.
bool varies(const plant::DisturbanceSpec& disturbance, double from_s, double to_s) {
  const double end_s = disturbance.end_s.value_or(INFINITY);
  const auto inside = [&](double t) { return t > from_s && t < to_s; };
  if (inside(disturbance.start_s) || inside(end_s)) return true;
  return disturbance.shape != plant::DisturbanceShape::constant && disturbance.start_s < to_s &&
         end_s > from_s;
}

/// Returns the first and the last reference of a run.
std::vector<Vector> rest_postures(const std::vector<Joint>& joints) {
  std::vector<Vector> result(2, Vector::Zero(static_cast<Eigen::Index>(joints.size())));
  for (std::size_t i = 0; i < joints.size(); ++i) {
    result[0][static_cast<Eigen::Index>(i)] = joints[i].q_ref.front().y;
    result[1][static_cast<Eigen::Index>(i)] = joints[i].q_ref.back().y;
  }
  if (result[0] == result[1]) result.pop_back();
  return result;
}

Context context_of(const std::vector<Joint>& joints, const Yardsticks& yardsticks) {
  Context result;
  const double end = joints.front().end, from = 3 * joints.front().quarter;
  result.disturbed = yardsticks.disturbed && yardsticks.disturbed(from, end);
  result.rests = !result.disturbed;
  double rests_from = 0;
  for (const Joint& joint : joints) {
    result.rests = result.rests && joint.in_quarter(joint.q_ref, 3).extent() == 0;
    rests_from = std::max(rests_from, rests_from_s(joint.q_ref));
  }
  result.rested_s = end - rests_from;
  result.period_s = yardsticks.period_s;
  result.saturates =
      std::ranges::any_of(yardsticks.saturated_share, [](double share) { return share > 0; });
  return result;
}

void judge_all(std::vector<Joint>& joints, const Context& context, const Yardsticks& yardsticks,
               Verdict& result) {
  for (Joint& joint : joints) joint.judge(context);
  judge_worst(joints, yardsticks, result);
}

}  // namespace

Yardsticks yardsticks(const scenario::Scenario& scenario) {
  Yardsticks result;
  result.friction = scenario::largest_friction(scenario);
  result.resolution = scenario::encoder_count(scenario, *scenario.model)
                          .cwiseMax(scenario.plant.encoder.noise_std_rad);
  result.realtime = scenario.loop.mode == scenario::Mode::realtime;
  result.held = std::holds_alternative<reference::trajectory::Hold>(scenario.reference);
  result.period_s = common_period_s(reference::composition_of(scenario.reference).sines);
  result.disturbed = [all = scenario.plant.disturbances](double from_s, double to_s) {
    return std::ranges::any_of(
        all, [&](const auto& disturbance) { return varies(disturbance, from_s, to_s); });
  };
  return result;
}

double rests_from_s(const std::vector<Point>& q_ref) {
  if (q_ref.empty()) return 0;
  const double end = q_ref.back().x;
  const double tolerance = 1e-12 * span(q_ref, 0, end).extent();  // the rounding of a polynomial
  double moved_s = 0;
  for (const Point& point : q_ref) {
    if (std::abs(point.y - q_ref.back().y) > tolerance) moved_s = point.x;
  }
  return moved_s < 0.95 * end ? moved_s : 0;
}

Verdict judge(const Tracking& tracking, const Yardsticks& yardsticks) {
  Verdict result;
  if (tracking.num_ticks() < fewest_ticks) return result;
  std::vector<Joint> joints;
  for (std::size_t i = 0; i < tracking.joints().size(); ++i) {
    joints.emplace_back(tracking.joints()[i], entry(yardsticks.resolution, i),
                        entry(yardsticks.friction, i), yardsticks.realtime);
  }
  set_scales(joints);
  Context context = context_of(joints, yardsticks);
  judge_all(joints, context, yardsticks, result);
  if (result.outcome != Outcome::converged && yardsticks.loop) {
    context.loop = yardsticks.loop(rest_postures(joints));
    for (std::size_t i = 0; i < joints.size(); ++i) {
      joints[i].deviation = entry(context.loop.noise, i);
    }
    judge_all(joints, context, yardsticks, result);
  }
  double above_s = 0;
  for (const Joint& joint : joints) {
    above_s = std::max(above_s, joint.above_s());
    result.counted_from_s = std::max(result.counted_from_s, rests_from_s(joint.q_ref));
    result.moves = result.moves || span(joint.q_ref, 0, joint.end).extent() > 0;
  }
  result.held = yardsticks.held;
  result.settled_s = std::max(0.0, above_s - result.counted_from_s);
  result.loop_settles_s = context.loop.stable ? context.loop.settling_s : 0;
  result.rested_s = context.rested_s;
  const std::vector<double>& saturated = yardsticks.saturated_share;
  const auto most = std::ranges::max_element(saturated);
  if (most != saturated.end() && *most > 0) result.saturated_share = *most;
  if (result.saturated_share > 0.5 && result.outcome < Outcome::saturated) {
    result.outcome = Outcome::saturated;
    result.joint = static_cast<std::size_t>(most - saturated.begin());
  }
  if (!bad(result.outcome)) {
    for (Joint& joint : joints) joint.judge_by_scale(context);
    judge_worst(joints, yardsticks, result);
  }
  return result;
}

namespace {

std::string lag_text(const Verdict& verdict) {
  switch (verdict.cause) {
    case Cause::settling:
      if (verdict.loop_settles_s > verdict.rested_s) {
        return fmt::format("; the loop settles in {:.2g} s, the run gave it {:.2g} s",
                           verdict.loop_settles_s, verdict.rested_s);
      }
      return "; still settling: the error decays";
    case Cause::disturbance:
      return "; a disturbance makes it";
    case Cause::motion:
      return fmt::format("; {}{} makes it", verdict.moves ? "the motion" : "a disturbance",
                         verdict.friction > 0 ? ", or dry friction," : "");
    default:
      return "";
  }
}

}  // namespace

std::string text(const Verdict& verdict, const robot::JointLabels& joints) {
  const std::string joint = joints.joint(verdict.joint);
  const std::string& length = joints.length[verdict.joint];
  switch (verdict.outcome) {
    case Outcome::converged: {
      const std::string unmoved =
          verdict.moves || verdict.held
              ? ""
              : "; the reference did not move in this run: check the times of its table";
      if (verdict.settled_s == 0) {
        return (verdict.counted_from_s > 0 ? "converged when the motion ends"
                                           : "converged throughout") +
               unmoved;
      }
      return fmt::format("converged, settled within {:.3g} s{}{}", verdict.settled_s,
                         verdict.counted_from_s > 0 ? " of the motion's end" : "", unmoved);
    }
    case Outcome::lags:
      return fmt::format(
          "lags: error up to {:.2g} {} in the last quarter at {}, {} % of its scale{}",
          verdict.error, length, joint,
          fmt::format(fmt::runtime(verdict.share < 0.1 ? "{:.2g}" : "{:.0f}"), 100 * verdict.share),
          lag_text(verdict));
    case Outcome::rests_beside:
      return fmt::format("rests beside: {} rests {:.2g} {} beside its reference{}", joint,
                         verdict.error, length,
                         held_text(verdict, length, joints.effort[verdict.joint]));
    case Outcome::saturated:
      return fmt::format("saturated: {} at its torque or rate limit in {:.0f} % of ticks", joint,
                         100 * verdict.saturated_share);
    case Outcome::oscillates:
      return fmt::format("oscillates: {} swings by {:.2g} {} at {:.3g} Hz or more", joint,
                         verdict.error, length, verdict.frequency_hz);
    case Outcome::diverging:
      return fmt::format("diverging: the error of {} has grown to {:.2g} {}", joint, verdict.error,
                         length);
    case Outcome::stopped:
      return verdict.reason.starts_with(verdict.word())
                 ? verdict.reason
                 : fmt::format("stopped: {}", verdict.reason);
    case Outcome::not_judged:
      break;
  }
  return fmt::format("not judged: {}", verdict.reason.empty() ? "too few ticks" : verdict.reason);
}

}  // namespace tachless::study
