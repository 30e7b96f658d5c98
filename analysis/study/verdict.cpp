#include "study/verdict.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace tachless::study {
namespace {

constexpr std::int64_t fewest_ticks = 40;
constexpr double converged_share = 0.01, followed_share = 0.05;  // of the scale
constexpr double counts = 3;  // of the encoder, which no error has to be below
// Counts that the loop makes into larger swings, of another size in each quarter: up to 11 seen.
constexpr double swing_counts = 10;
constexpr double least = 1e-6;  // [rad; m] nor below this: a count of 22 bits is 1.5e-6
// [rad; m] Below, no limit cycle is called so, nor in real time any growth of swings: encoders,
// noise and late commands swing too.
constexpr double small = 1e-3;
constexpr double still = 1e-3;     // of an error: how far a joint that rests may move
constexpr double constant = 0.05;  // of an error: how far one that is called constant may change
// Of what the reference does: how far, or fast, a joint moves that friction holds most of the time.
constexpr double hardly = 0.2, at_rest = 0.01;
constexpr double rests_for = 0.25;  // of the time
// Of the largest scale: a joint that has less only holds its place, against what the others do.
constexpr double holds = 1e-3;

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

/// A joint's run in the numbers that decide.
struct Joint {
  std::vector<Point> error, q, q_ref;
  double end, quarter, own_scale, noise, smallest_swing, friction;
  double scale = 0;
  Outcome outcome = Outcome::converged;
  std::array<Span, 4> in;  ///< the error in each quarter
  Span last, position;     ///< the error in the last quarter; q in it
  int fast;                ///< turns in the last quarter, by as much as the error's peak

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
        in{of(error, 0), of(error, 1), of(error, 2), of(error, 3)},
        last(in[3]),
        position(of(q, 3)),
        fast(turns(error, 3 * quarter, end, last.peak())) {}

  [[nodiscard]] Span of(const std::vector<Point>& points, int i) const {
    return span(points, i * quarter, (i + 1) * quarter);
  }
  [[nodiscard]] double allowed(double share) const { return std::max(share * scale, noise); }
  [[nodiscard]] bool within(double share) const { return last.peak() <= allowed(share); }
  [[nodiscard]] int turns_in(const std::vector<Point>& points, int i, double amplitude) const {
    return turns(points, i * quarter, (i + 1) * quarter, amplitude);
  }
  /// How often an error turns in a quarter at least that does so without being asked to.
  [[nodiscard]] int unasked(int i) const {
    const int asked = turns_in(q_ref, i, 0.1 * span(q_ref, 0, end).extent());
    return std::max(6, 3 * (asked + 1) + 1);
  }

  /// How large the swings in a quarter are that the reference does not ask for: by how much the
  /// error goes back that often. The slow error on which they ride is not in it. 0: by noise.
  [[nodiscard]] double swing(int i) const {
    const int often = unasked(i);
    double low = smallest_swing, high = in[static_cast<std::size_t>(i)].extent();
    if (turns_in(error, i, low) < often) return 0;
    constexpr double precision = 1.005;
    for (int step = 0; step < 40 && high > precision * low; ++step) {
      const double middle = std::sqrt(low) * std::sqrt(high);
      (turns_in(error, i, middle) < often ? high : low) = middle;
    }
    return low;
  }
  /// Whether its swings grow from quarter to quarter, however small they are.
  [[nodiscard]] bool swings_grow() const {
    constexpr double growth = 1.3;
    const double now = swing(3), before = now > 0 ? swing(2) : 0;
    if (before == 0 || now <= growth * before) return false;
    const double first = swing(1);
    return first > 0 && before > growth * first;
  }
  [[nodiscard]] bool diverges() const {
    if (swings_grow()) return true;
    const double first_half = std::max(in[0].peak(), in[1].peak());
    if (within(followed_share) || last.peak() <= 4 * first_half) return false;
    const double asked_before = span(q_ref, 0, 2 * quarter).extent();
    return last.peak() > scale || of(q_ref, 3).extent() <= asked_before;
  }
  [[nodiscard]] bool cycles() const {
    const bool lasts = last.peak() >= 0.8 * in[2].peak();
    return last.peak() > std::max(small, noise) && lasts && fast >= unasked(3);
  }
  /// Whether dry friction holds it, though its reference may go on.
  [[nodiscard]] bool sticks() const {
    if (position.extent() <= still * last.peak()) return true;
    const double way = sum_of_steps(q_ref, 3 * quarter, end, [](double, double up) { return up; });
    const double speed = at_rest * way / quarter;
    const auto slow = [&](double time, double up) { return up <= speed * time ? time : 0; };
    return position.extent() <= hardly * of(q_ref, 3).extent() &&
           sum_of_steps(q, 3 * quarter, end, slow) >= rests_for * quarter;
  }
  [[nodiscard]] Outcome judged() const {
    if (diverges()) return Outcome::diverging;
    if (cycles()) return Outcome::limit_cycle;
    if (within(converged_share)) return Outcome::converged;
    if (within(followed_share)) return Outcome::followed;
    if (friction > 0 && sticks()) return Outcome::stuck;
    // On a motion that is slower than the run an error is nearly constant too.
    if (last.extent() < constant * last.peak() && position.extent() < last.peak()) {
      // It is not to be seen where an error will rest that falls nearly as fast as before.
      const double before = in[2].extent();
      const bool falls = in[2].peak() - last.peak() > 0.9 * before &&
                         last.extent() > std::max(noise, 0.5 * before);
      return falls ? Outcome::slow : Outcome::rests_beside;
    }
    return !within(1) || last.peak() < 0.95 * in[2].peak() ? Outcome::slow : Outcome::lags;
  }
  /// What an error beyond the scale is, which no motion makes and no start that decays, unless it
  /// falls; else the outcome that it has.
  [[nodiscard]] Outcome judged_by_scale() const {
    constexpr double less = 0.995;
    const double before = in[2].peak(), now = last.peak();
    const bool falls = now < less * before && before < less * in[1].peak() && now < in[0].peak();
    if (within(1) || falls) return outcome;
    if (now > 1.25 * before) return Outcome::diverging;
    if (last.low > 0 || last.high < 0) return Outcome::rests_beside;
    return fast > 1 ? Outcome::limit_cycle : Outcome::diverging;
  }
  /// When the error was last beyond 1 % of the scale.
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

/// Sets what the worst joint is: of equally bad ones that with the largest share of its scale.
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
    result.joint = i;
    result.error = joint.last.peak();
    result.share = share;
    result.frequency_hz = joint.fast / (2 * joint.quarter);
    result.friction = joint.friction;
    result.stiffness = entry(yardsticks.stiffness, i);
  }
}

/// What a resting error means: what holds the joint there.
std::string held_text(const Verdict& verdict, std::string_view length, std::string_view effort) {
  if (verdict.stiffness <= 0) return "";
  const double reach = verdict.friction / verdict.stiffness;
  if (verdict.outcome == Outcome::stuck && verdict.error <= 1.05 * reach) {
    return fmt::format("; dry friction of {:.3g} {} holds it up to F_c/kp = {:.2g} {}",
                       verdict.friction, effort, reach, length);
  }
  return fmt::format(
      "; d/kp: a torque of about {:.2g} {} that the law does not know, over kp = {:.3g}",
      verdict.error * verdict.stiffness, effort, verdict.stiffness);
}

}  // namespace

Yardsticks yardsticks(const scenario::Scenario& scenario) {
  Yardsticks result;
  const plant::DriveSpec& drive = scenario.plant.drive;
  result.friction = drive.coulomb_friction_Nm.cwiseMax(
      drive.static_friction_Nm.value_or(drive.coulomb_friction_Nm));
  result.resolution = scenario::encoder_count(scenario, *scenario.model)
                          .cwiseMax(scenario.plant.encoder.noise_std_rad);
  result.realtime = scenario.loop.mode == scenario::Mode::realtime;
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
  double above_s = 0;
  for (Joint& joint : joints) {
    joint.outcome = joint.judged();
    above_s = std::max(above_s, joint.above_s());
    result.counted_from_s = std::max(result.counted_from_s, rests_from_s(joint.q_ref));
    result.moves = result.moves || span(joint.q_ref, 0, joint.end).extent() > 0;
  }
  judge_worst(joints, yardsticks, result);
  result.settled_s = std::max(0.0, above_s - result.counted_from_s);
  const std::vector<double>& saturated = yardsticks.saturated_share;
  const auto most = std::ranges::max_element(saturated);
  if (most != saturated.end() && *most > 0) result.saturated_share = *most;
  if (result.saturated_share > 0.5 && result.outcome < Outcome::saturated) {
    result.outcome = Outcome::saturated;
    result.joint = static_cast<std::size_t>(most - saturated.begin());
  }
  if (!bad(result.outcome)) {
    for (Joint& joint : joints) joint.outcome = joint.judged_by_scale();
    judge_worst(joints, yardsticks, result);
  }
  return result;
}

std::string text(const Verdict& verdict, const robot::JointLabels& joints) {
  const std::string joint = joints.joint(verdict.joint);
  const std::string& length = joints.length[verdict.joint];
  const auto up_to = [&](std::string_view word, std::string_view why) {
    return fmt::format(
        "{}: error up to {:.2g} {} in the last quarter at {}, {} % of its scale{}", word,
        verdict.error, length, joint,
        fmt::format(fmt::runtime(verdict.share < 0.1 ? "{:.2g}" : "{:.0f}"), 100 * verdict.share),
        why);
  };
  switch (verdict.outcome) {
    case Outcome::converged:
      if (verdict.settled_s == 0)
        return verdict.counted_from_s > 0 ? "converged when the motion ends"
                                          : "converged throughout";
      return fmt::format("converged, settled within {:.3g} s{}", verdict.settled_s,
                         verdict.counted_from_s > 0 ? " of the motion's end" : "");
    case Outcome::followed:
      return up_to("followed", "");
    case Outcome::lags:
      return up_to("lags",
                   fmt::format("; {}{} makes it", verdict.moves ? "the motion" : "a disturbance",
                               verdict.friction > 0 ? ", or dry friction," : ""));
    case Outcome::slow:
      return up_to("slow", ", decaying; a longer run would show more");
    case Outcome::rests_beside:
    case Outcome::stuck:
      return fmt::format("{}: {} rests {:.2g} {} beside its reference{}",
                         verdict.outcome == Outcome::stuck ? "stuck" : "rests beside", joint,
                         verdict.error, length,
                         held_text(verdict, length, joints.effort[verdict.joint]));
    case Outcome::saturated:
      return fmt::format("saturated: {} at its torque or rate limit in {:.0f} % of ticks", joint,
                         100 * verdict.saturated_share);
    case Outcome::limit_cycle:
      return fmt::format("limit cycle: {} swings by {:.2g} {} at {:.3g} Hz or more", joint,
                         verdict.error, length, verdict.frequency_hz);
    case Outcome::diverging:
      return fmt::format("diverging: the error of {} has grown to {:.2g} {}", joint, verdict.error,
                         length);
    case Outcome::outside:
      return fmt::format(
          "outside: it starts {:.3g} {} beside its reference, where a run is broken off",
          verdict.error, length);
    case Outcome::interrupted:
    case Outcome::stopped:
      return verdict.reason.starts_with(verdict.word())
                 ? verdict.reason
                 : fmt::format("{}: {}", verdict.word(), verdict.reason);
    case Outcome::not_judged:
      break;
  }
  return fmt::format("not judged: {}", verdict.reason.empty() ? "too few ticks" : verdict.reason);
}

}  // namespace tachless::study
