#include "certify/certify.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <numbers>
#include <string_view>
#include <utility>

#include "base/json_text.h"
#include "base/text.h"
#include "lyapunov/law_loop.h"
#include "reference/make_trajectory.h"
#include "robot/model.h"

namespace tachless::certify {
namespace {

using base::period_text;
using Json = nlohmann::ordered_json;

/// Returns null for a number that is not finite.
Json json_of(double x) { return std::isfinite(x) ? Json(x) : Json(); }
Json json_of(const std::optional<double>& x) { return x ? json_of(*x) : Json(); }
Json json_of(const Eigen::VectorXd& x) { return base::json_list(x); }

/// A printed result. Text and JSON are made of these results, in their order.
struct Entry {
  std::string_view key, label;  ///< without a label only in JSON, without a key only in the text
  Json value;
  std::string text;
};
/// The lines of the short page, in their order.
enum class Line {
  sampled_loop,
  margins,
  margins_of_drives,
  host_delay,
  count_of_drives,
  missed_commands,
  friction,
  not_counted,
  reference,
  region,
  globally
};
constexpr std::array<std::string_view, 11> line_labels{
    "sampled loop",    "margins",          "margins of drives", "host delay",
    "count of drives", "missed commands",  "friction",          "not counted",
    "reference",       "certified region", "globally"};

struct Group {
  std::string_view key;
  std::string heading;
  std::vector<Entry> entries;
  std::map<Line, std::string> lines{};  ///< of the short page

  void add(std::string_view name, std::string_view label, Json value, std::string text) {
    entries.push_back({name, label, std::move(value), std::move(text)});
  }
};

/// Returns why a loop has no margins.
std::string no_margins(const Prediction& loop) {
  return loop.unstable_q.size() == 0
             ? "none"
             : "none: at rest it is unstable at q = " + list_text(loop.unstable_q);
}

/// Adds the margins and the missed ticks.
void add_margins(Group& group, const Prediction& p, const std::optional<int>& max_missed) {
  if (p.margins) {
    const linear::Margins& g = *p.margins;
    group.add("margins", "margins",
              {{"gain", json_of(g.gain)},
               {"least_gain", g.least_gain},
               {"phase_deg", g.phase_deg},
               {"delay_s", json_of(g.delay_s)},
               {"modulus", g.modulus},
               {"modulus_independent", g.modulus_independent}},
              margins_text(g));
    group.add("margin_q", "modulus margin", json_of(p.margin_q),
              fmt::format("{}, at q = {}", modulus_text(g), list_text(p.margin_q)));
    group.lines[Line::margins] = fmt::format("modulus {}; {}", modulus_text(g), margins_text(g));
  } else {
    group.lines[Line::margins] = no_margins(p);
  }
  if (!p.missed) return;
  const linear::MissedTicks& missed = *p.missed;
  group.add("missed", "missed commands",
            {{"status", "searched"},
             {"commands", missed.commands},
             {"measurements", missed.measurements ? Json(*missed.measurements) : Json()},
             {"unstable", missed.unstable ? Json(*missed.unstable) : Json()},
             {"unstable_hits", missed.unstable ? Json(missed.hits) : Json()}},
            missed_text(missed));
  if (missed.measurements)
    group.add("", "missed measurements", Json(), pattern_text(*missed.measurements));
  if (!max_missed) return;
  group.lines[Line::missed_commands] =
      missed_text(missed) +
      (*max_missed <= missed.commands
           ? ""
           : fmt::format(" (loop.max_missed is {}: NOT covered)", *max_missed));
}

/// @param max_missed loop.max_missed of a realtime scenario
Group loop_group(const Prediction& p, const std::optional<int>& max_missed = {}) {
  Group group{"sampled", "Sampled loop", {}};
  group.lines[Line::sampled_loop] = text(p);
  if (!p.not_counted.empty()) group.lines[Line::not_counted] = p.not_counted;
  if (!p.unknown.empty()) {
    group.lines[Line::margins] = no_margins(p);
    group.add("unknown", "not examined", p.unknown,
              fmt::format("the law cannot be linearised ({})", p.unknown));
    return group;
  }
  group.heading += " (linearised at the worst postures of the reference that were found)";
  group.add("stable", "stable", p.stable,
            !p.stable ? "NO: " + growth_text(p)
            : p.growth > 0
                ? fmt::format("where the motion ends; errors grow {:.2g}-fold over the motion "
                              "before they decay",
                              p.growth)
            : p.unstable_q.size() > 0
                ? "along the motion, but not at rest at q = " + list_text(p.unstable_q)
                : std::string("yes"));
  group.add("period_s", "", p.settings.period_s, "");
  group.add("delay", "", p.settings.command_delay, "");
  group.add("not_counted", p.not_counted.empty() ? "" : "not counted", p.not_counted,
            p.not_counted);
  group.add("limit_s", "largest stable period", json_of(p.limit_s),
            fmt::format("{} (at q = {})", limit_text(p.limit_s), list_text(p.limit_q)));
  group.add("limit_q", "", json_of(p.limit_q), "");
  group.add("spectral_radius", "spectral radius, per period", json_of(p.radius),
            fmt::format("{:.6g}", p.radius));
  group.add("growth_over_motion", "", p.growth > 0 ? json_of(p.growth) : Json(), "");
  const linear::Modes& m = p.modes;
  if (m.stable) {
    group.add("settling_s", "settles to 1 % in", m.settling_s, settling_text(m.settling_s));
    group.add("decay_per_s", "slowest mode decays at", json_of(m.decay_per_s),
              fmt::format("{:.4g} 1/s", m.decay_per_s));
  }
  group.add("least_damped", "least damped mode",
            {{"hz", m.least_damped_hz}, {"damping", m.least_damping}},
            m.least_damping < 1
                ? fmt::format("{:.3g} Hz, damping {:.2g}", m.least_damped_hz, m.least_damping)
                : "none oscillates");
  add_margins(group, p, max_missed);
  group.add("gain_Nm_per_rad", "torque per angle", json_of(p.gain_Nm_per_rad),
            fmt::format("{} {}", list_text(p.gain_Nm_per_rad), p.stiffness_unit));
  group.add("stiffness_Nm_per_rad", "stiffness at rest", json_of(p.stiffness),
            fmt::format("{} {}", list_text(p.stiffness), p.stiffness_unit));
  group.add("rest_error", p.rest_error.size() > 0 ? "F_c/kp" : "", json_of(p.rest_error),
            list_text(p.rest_error));
  if (const std::string held = friction_text(p); !held.empty()) {
    group.lines[Line::friction] = held;
  }
  group.add("count_torque_Nm", p.count_Nm ? "torque per encoder count" : "",
            p.count_Nm ? json_of(*p.count_Nm) : Json(),
            p.count_Nm ? fmt::format("{} {}", list_text(*p.count_Nm), p.torque_unit) : "");
  return group;
}

Group drive_group(const DrivePrediction& d) {
  Group group{"drive_loop", "Loop inside the drives (the host's loop is closed around it)", {}};
  group.add("margins", "margins",
            {{"gain", json_of(d.margins.gain)},
             {"delay_ticks", d.margins.delay_ticks},
             {"delay_s", d.delay_s},
             {"modulus", d.margins.modulus}},
            margins_text(d));
  group.add("host_delay_s", "largest host delay", d.host_delay_ends ? Json(d.host_delay_s) : Json(),
            host_delay_text(d));
  group.add(
      "count_torque_Nm", "torque per count of the drives", json_of(d.count_Nm),
      d.count_Nm.isZero(0) ? "none: their encoders are ideal" : list_text(d.count_Nm) + " N m");
  group.lines[Line::margins_of_drives] = margins_text(d);
  group.lines[Line::host_delay] = host_delay_text(d);
  if (!d.count_Nm.isZero(0)) {
    group.lines[Line::count_of_drives] = list_text(d.count_Nm) + " N m each";
  }
  return group;
}

/// Returns the largest share of a torque or speed limit that the reference needs: "57 % of the
/// torque limit (elbow)". If no joint has a limit, returns the largest value: "345 N m (elbow, no
/// limit)".
std::string largest_text(const Feasibility& f, bool speed) {
  std::pair<bool, double> largest;
  std::string text;
  for (const JointDemand& joint : f.joints) {
    const auto& limit = speed ? joint.speed_limit : joint.torque_limit;
    double share = (speed ? joint.speed : joint.moving) / limit.value_or(1);
    const auto& tight = joint.tight_speed;
    if (speed && tight && tight->speed > 0) share = std::max(share, tight->speed / tight->limit);
    if (std::pair(limit.has_value(), share) < largest) continue;
    largest = {limit.has_value(), share};
    text = limit ? fmt::format("{:.0f} % of the {} limit ({})", 100 * share,
                               speed ? "speed" : "torque", joint.name)
                 : fmt::format("{:.4g} {} ({}, no limit)", share,
                               speed ? joint.speed_unit : joint.torque_unit, joint.name);
  }
  return text;
}

/// Returns the demands of the reference, or those that cannot be met.
std::string demand_text(const Feasibility& f) {
  if (!f.impossible.empty()) return fmt::format("{}", fmt::join(f.impossible, "; "));
  std::string text = fmt::format("needs {}, {}", largest_text(f, false), largest_text(f, true));
  for (const std::string& doubt : f.doubtful) text += "; doubtful: " + doubt;
  return text;
}

Group reference_group(const Feasibility& f) {
  Group group{"feasibility", "Demands of the reference (errors come on top)", {}};
  const auto of_limit = [](double value, const std::optional<double>& limit) {
    return limit ? fmt::format("{:.4g} of {:g}", value, *limit) : fmt::format("{:.4g}", value);
  };
  Json joints = Json::array();
  for (const JointDemand& joint : f.joints) {
    joints.push_back({{"name", joint.name},
                      {"torque_at_rest", joint.at_rest},
                      {"torque_moving", joint.moving},
                      {"torque_limit", json_of(joint.torque_limit)},
                      {"speed", joint.speed},
                      {"speed_limit", json_of(joint.speed_limit)},
                      {"cycles_per_tick", joint.cycles_per_tick}});
    std::string text =
        fmt::format("torque {}, speed {}", of_limit(joint.moving, joint.torque_limit),
                    of_limit(joint.speed, joint.speed_limit));
    if (const auto& tight = joint.tight_speed) {
      joints.back()["tight_speed"] = {{"at_s", tight->at_s},
                                      {"position", tight->position},
                                      {"speed", tight->speed},
                                      {"limit", tight->limit}};
      if (tight->limit < joint.speed_limit.value_or(infinity)) {
        text += fmt::format(", {:.4g} of {:.4g} near an end of its range at {:.4g} s", tight->speed,
                            tight->limit, tight->at_s);
      }
    }
    if (joint.feedforward_max) {
      joints.back()["feedforward_max"] = *joint.feedforward_max;
      joints.back()["feedforward_anywhere"] = *joint.feedforward_anywhere;
      joints.back()["feedforward_proved"] = joint.feedforward_proved;
      text += fmt::format(", feed-forward {} at any posture ({}), {:.0f} % of the limit",
                          of_limit(*joint.feedforward_anywhere, joint.feedforward_max),
                          joint.feedforward_proved ? "proved" : "sampled",
                          100 * *joint.feedforward_max / joint.torque_limit.value_or(infinity));
    }
    group.add("", joint.name, Json(), std::move(text));
  }
  group.add("joints", "", std::move(joints), "");
  for (const std::string& problem : f.impossible) group.add("", "IMPOSSIBLE", Json(), problem);
  for (const std::string& doubt : f.doubtful) group.add("", "doubtful", Json(), doubt);
  group.add("impossible", "", f.impossible, "");
  group.add("doubtful", "", f.doubtful, "");
  group.lines[Line::reference] = demand_text(f);
  return group;
}

/// `before`, and the share of a torque limit that the start may need; empty where none is known.
std::string share_text(const lyapunov::CertifiedStart& start, std::string_view before) {
  if (!start.torque_share) return {};
  return fmt::format("{}needs at most {:.0f} % of a limit", before, 100 * *start.torque_share);
}

Eigen::VectorXd start_range_of(const scenario::Scenario& scenario) {
  const robot::Model& model = *scenario.model;
  const Vector q_ref = reference::make_trajectory(scenario).at(0).q_ref;
  Eigen::VectorXd range = (model.upper - q_ref).cwiseMax(q_ref - model.lower);
  for (Eigen::Index i = 0; i < range.size(); ++i) {
    const bool turns = model.joint_types[static_cast<std::size_t>(i)] == robot::JointType::revolute;
    if (turns && !std::isfinite(range[i])) range[i] = std::numbers::pi;
  }
  return range;
}

/// Returns the errors, of the links no more than the joints' range.
Eigen::VectorXd within(Eigen::VectorXd errors, const Eigen::VectorXd& range) {
  errors.head(range.size()) = errors.head(range.size()).cwiseMin(range);
  return errors;
}

/// "up to |e_i| = [0.3, 1.2]", "anywhere in the joints' range".
std::string reach_text(const Eigen::VectorXd& errors, const Eigen::VectorXd& range) {
  const auto whole = errors.head(range.size()).array() >= range.array();
  if (range.size() > 0 && whole.all()) return "anywhere in the joints' range";
  std::string text = "up to |e_i| = " + list_text(within(errors, range));
  std::vector<Eigen::Index> joints;
  for (Eigen::Index i = 0; i < range.size(); ++i) {
    if (whole[i]) joints.push_back(i + 1);
  }
  if (!joints.empty()) {
    text += fmt::format(" (joint{} {}: the whole range)", joints.size() > 1 ? "s" : "",
                        fmt::join(joints, ", "));
  }
  return text;
}

/// Returns where torque limits end the region.
std::string torque_text(const lyapunov::CertifiedRegion& c, const Eigen::VectorXd& range) {
  if (c.torque->level >= c.region.level) return "no limit is reached in the region";
  return fmt::format("without saturation from rest {} (joint {} is first)",
                     reach_text(c.torque->e_at_rest, range), c.torque->joint + 1);
}

std::string integral_text(double share) {
  return fmt::format("costs at most {:.2g} % of the level, whatever wound it up before",
                     100 * share);
}

void add(Group& group, std::string_view key, std::string_view name,
         const std::optional<lyapunov::CertifiedRegion>& c, const Eigen::VectorXd& range) {
  if (!c) return group.add(key, name, Json(), "nothing certified: no weights were found");
  const lyapunov::Region& region = c->region;
  Json values = {{"epsilon_1", json_of(c->weights.eps_1)},
                 {"epsilon_2", json_of(c->weights.eps_2)},
                 {"rate_per_s", c->rate > 0 ? json_of(c->rate) : Json()},
                 {"error_rate_per_s", c->rate > 0 ? json_of(c->rate / 2) : Json()},
                 {"level", json_of(region.level)},
                 {"ball", json_of(region.ball)},
                 {"e_at_rest", json_of(within(region.e_at_rest, range))},
                 {"edot", json_of(region.edot)},
                 {"unknown_torque_Nm", json_of(c->unknown_torque)},
                 {"friction_error", c->friction_error ? json_of(*c->friction_error) : Json()},
                 {"tube", c->tube.size() > 0 ? json_of(c->tube) : Json()},
                 {"torque_level", c->torque ? json_of(c->torque->level) : Json()},
                 {"torque_share", c->torque ? json_of(c->torque->share) : Json()},
                 {"initial_state", {{"V", c->V0}, {"certified", c->holds_initial_state()}}}};
  if (c->integral_share) values["integral_share"] = json_of(c->integral_share);
  group.add(
      key, name, std::move(values),
      fmt::format("this start: {} (V = {:.4g} J of {:.4g} J)",
                  c->holds_initial_state() ? "certified" : "NOT certified", c->V0, region.level));
  group.add("", "  one error alone, from rest", Json(), reach_text(region.e_at_rest, range));
  group.add("", "  one rate alone, up to", Json(), list_text(region.edot));
  if (c->tube.size() > 0)
    group.add("", "  postures", Json(), "within " + list_text(c->tube) + " of the reference");
  group.add("", "  small errors decay at", Json(),
            c->rate > 0 ? fmt::format("{:.4g} 1/s", c->rate / 2) : "no certified rate");
  if (c->torque) group.add("", "  torque", Json(), torque_text(*c, range));
  if (c->unknown_torque.size() > 0)
    group.add("", "  unknown torque at one joint, up to", Json(),
              list_text(c->unknown_torque) + " N m, constant; errors then end at 0");
  if (c->integral_share) group.add("", "  integral", Json(), integral_text(*c->integral_share));
  if (c->friction_error) {
    group.add("", "  with friction errors end within", Json(),
              c->friction_error->size() > 0 ? list_text(*c->friction_error) : "no certified bound");
  }
}

/// Returns true if a bounded law's feed-forward is clipped at some posture: its proof excludes
/// that.
bool clips_feedforward(const Feasibility& feasibility) {
  return std::ranges::any_of(feasibility.joints, [](const JointDemand& joint) {
    return joint.feedforward_max && *joint.feedforward_anywhere > *joint.feedforward_max;
  });
}

/// Returns whether every start converges, and why.
std::string global_text(const lyapunov::GlobalConvergence& global) {
  return (global.shown ? "yes: " : "not shown: ") + global.why;
}

/// Returns what the unknown parameters take of the level.
std::string parameters_text(const lyapunov::WeightedRegion& w) {
  return fmt::format("the unknown parameters take at most {:.2g} % of the level",
                     100 * *w.of_parameters / w.region.level);
}

void add_provisos(Group& group, const std::vector<std::string>& provisos) {
  for (const std::string& proviso : provisos) group.add("", "proviso", Json(), proviso);
  group.add("provisos", "", provisos, "");
}

/// Returns the larger of the regions that contain the start, or the larger of both; then what the
/// proof does not cover.
std::string region_text(const lyapunov::StabilityCertificate& s, const Eigen::VectorXd& range) {
  const bool faster =
      !s.largest || (lyapunov::holds_start(s.fastest) && !lyapunov::holds_start(s.largest));
  const auto& region = faster ? s.fastest : s.largest;
  std::string rest = share_text(s.start, "; torque: this start ");
  if (region && region->torque)
    rest += (rest.empty() ? "; torque: " : "; ") + torque_text(*region, range);
  if (region && region->integral_share)
    rest += "; the integral " + integral_text(*region->integral_share);
  for (const std::string& proviso : s.provisos) rest += "; " + proviso;
  if (!region)
    return (s.constant && s.start.certified ? "this start is certified, but without a rate"
                                            : "none: no weights were found") +
           rest;
  return fmt::format(
      "{}{} in continuous time: this start is {}; from rest {}, one error at a time{}",
      s.proved ? "proved" : "at sampled postures",
      region->tube.size() > 0 ? " near the reference,"
      : s.proved              ? ""
                              : ",",
      lyapunov::holds_start(region)     ? "in it"
      : s.constant && s.start.certified ? "certified, but without a rate (constant reference)"
                                        : "NOT in it",
      reach_text(region->region.e_at_rest, range), rest);
}

std::string region_text(const lyapunov::WeightedRegion& w, const Eigen::VectorXd& range) {
  std::string rest = w.of_parameters ? "; " + parameters_text(w) : "";
  for (const std::string& proviso : w.provisos) rest += "; " + proviso;
  return fmt::format(
      "{} in continuous time: this start is {}; from rest {}, one joint displaced at a time{}",
      w.proved ? "proved" : "at sampled postures,", w.holds_initial_state() ? "in it" : "NOT in it",
      reach_text(w.e_at_rest, range), rest);
}

Group weighted_group(const lyapunov::WeightedRegion& w, const Eigen::VectorXd& range) {
  Group group{"region",
              fmt::format("Certified region ({}; continuous time, exact model: no saturation, "
                          "quantisation, delay or lead)",
                          w.proved ? "proved for all postures and instants"
                                   : "sampled postures and instants: not a proof"),
              {}};
  group.add("status", "", w.proved ? "proved" : "sampled", "");
  group.add(
      "start", "this start",
      {{"certified", w.holds_initial_state()}, {"proved", w.proved}, {"torque_share", Json()}},
      w.holds_initial_state() ? "certified" : "NOT certified");
  Json values = {{"level", json_of(w.region.level)},
                 {"rate_per_s", json_of(w.region.rate)},
                 {"error_rate_per_s", json_of(w.region.rate / 2)},
                 {"e_at_rest", json_of(within(w.e_at_rest, range))},
                 {"postures", w.forms},
                 {"parameters", json_of(w.of_parameters)},
                 {"initial_state", {{"V", w.V0}, {"certified", w.holds_initial_state()}}}};
  group.add("largest", "largest region", std::move(values),
            fmt::format("V = {:.4g} J of {:.4g} J, at {} postures and instants", w.V0,
                        w.region.level, w.forms));
  group.add("", "  one joint displaced, from rest", Json(), reach_text(w.e_at_rest, range));
  group.add("", "  small errors decay at", Json(), fmt::format("{:.4g} 1/s", w.region.rate / 2));
  if (w.of_parameters) group.add("", "  parameters", Json(), parameters_text(w));
  add_provisos(group, w.provisos);
  group.lines[Line::region] = region_text(w, range);
  return group;
}

Group region_group(const Certificate& all) {
  if (all.weighted) return weighted_group(*all.weighted, all.start_range);
  Group group{"region", "Certified region", {}};
  if (!all.stability) {
    group.add("none", "none", all.no_stability, all.no_stability);
    group.lines[Line::region] = "none: " + all.no_stability;
    return group;
  }
  const lyapunov::StabilityCertificate& s = *all.stability;
  group.heading +=
      fmt::format(" ({}; continuous time, exact model: no saturation, quantisation, delay or lead)",
                  s.proved ? "proved for all postures" : "sampled postures: not a proof");
  group.add("status", "", s.proved ? "proved" : "sampled", "");
  group.add("start", "this start", to_json(s.start),
            (s.start.certified ? "certified" : "NOT certified") + share_text(s.start, "; "));
  group.add("B_d", "", json_of(s.B_d), "");
  group.add("constant_reference", s.constant ? "constant reference" : "", s.constant,
            "asymptotically stable for any positive gains (LaSalle)");
  add(group, "fastest", s.own_weights ? "with the law's eps_1, eps_2" : "fastest rate", s.fastest,
      all.start_range);
  if (!s.constant && !s.own_weights) {
    add(group, "largest", "largest region", s.largest, all.start_range);
  }
  if (all.global) {
    const lyapunov::GlobalConvergence& global = *all.global;
    group.add("global", "globally",
              {{"shown", global.shown}, {"why", global.why}, {"g0", json_of(global.g0)}},
              global_text(global));
    group.lines[Line::globally] = global_text(global);
  }
  add_provisos(group, s.provisos);
  group.lines[Line::region] = region_text(s, all.start_range);
  return group;
}

Group nonlinear_group(const Certificate& all) {
  Group group{"sampled_nonlinear",
              "Sampled loop, nonlinear (the one-tick map as coded, its reference held)",
              {}};
  if (!all.nonlinear) {
    group.add("none", "none", all.no_nonlinear, all.no_nonlinear);
    return group;
  }
  const lyapunov::SampledRegion& r = *all.nonlinear;
  group.add("status", "status", "searched",
            fmt::format("searched in {} directions, not proved", r.directions));
  group.add("directions", "", r.directions, "");
  group.add("q_ref", "at q =", json_of(r.q_ref), list_text(r.q_ref));
  group.add("e_at_rest", "one error alone, from rest",
            json_of(within(r.e_at_rest, all.start_range)),
            reach_text(r.e_at_rest, all.start_range));
  group.add("edot", "one rate alone, up to", json_of(r.edot), list_text(r.edot));
  group.add("no_end_found", r.cut ? "no end found" : "", r.cut,
            fmt::format("up to where the search ends, an error of {:.3g}", r.widest));
  return group;
}

/// The paper's numbers, each with its equation.
Group paper_group(const lyapunov::PaperConditions& paper) {
  Group group{"paper", "Conditions as Loria and Ortega (1995) print them (one weight eps)", {}};
  const auto add = [&](std::string_view key, std::string_view label, double value) {
    group.add(key, label, json_of(value), fmt::format("{:.5g}", value));
  };
  const lyapunov::RobotConstants& c = paper.constants;
  add("lambda_min_M", "smallest eigenvalue of M [kg m2]", c.lambda_min_M.value);
  add("lambda_max_M", "largest eigenvalue of M [kg m2]", c.lambda_max_M.value);
  add("k_c", "k_c = sup |C(q, x)| [kg m2]", c.k_c.value);
  add("k_g", "k_g = sup |dg/dq| [N m/rad]", c.k_g.value);
  const lyapunov::PrintedConditions& p = paper.printed;
  add("eq7", "(7) b_i > … / beta_2", p.eq7);
  add("eq25", "(25) eps > … / beta_3", p.eq25);
  add("eq19", "(19) eps <", p.eq19);
  add("eq20", "(20) eps <", p.eq20);
  add("eq23", "(23) eps < gamma_1 …", p.eq23);
  add("eq24", "(24) eps < gamma_1 beta_1 …", p.eq24);
  add("eq27", "(27) eps <", p.eq27);
  group.add("feasible", p.feasible ? "" : "some eps", p.feasible, "no: infeasible");
  if (!p.feasible) return group;
  group.add("epsilon", "some eps", {p.epsilon.low, p.epsilon.high},
            fmt::format("{:.4g} … {:.4g}", p.epsilon.low, p.epsilon.high));
  add("c1", "(8) best c_1", p.c1);
  add("eq26", "(26) R", p.eq26);
  return group;
}

Json json_of(const Group& group) {
  Json json = Json::object();
  for (const Entry& entry : group.entries) {
    if (!entry.key.empty()) json[std::string(entry.key)] = entry.value;
  }
  return json;
}

std::vector<Group> groups(const Certificate& certificate) {
  std::vector<Group> all = {loop_group(certificate.loop, certificate.max_missed),
                            reference_group(certificate.feasibility), region_group(certificate)};
  if (certificate.drives) all.insert(all.begin() + 1, drive_group(*certificate.drives));
  if (certificate.nonlinear || !certificate.no_nonlinear.empty()) {
    all.push_back(nonlinear_group(certificate));
  }
  if (certificate.paper) all.push_back(paper_group(*certificate.paper));
  return all;
}

/// Returns the most important results in four lines. Missed commands in realtime, dry friction and
/// uncounted parts of the arm add one line each, and so does the statement on every start. A loop
/// inside the drives adds up to three.
std::string short_page(const std::vector<Group>& groups) {
  std::map<Line, std::string> all;
  for (const Group& group : groups) all.insert(group.lines.begin(), group.lines.end());
  std::string page;
  for (const auto& [line, text] : all) {
    page += fmt::format("  {:<17} {}\n", line_labels[static_cast<std::size_t>(line)], text);
  }
  return page;
}

}  // namespace

Certificate certify(const scenario::Scenario& scenario, const CertifyOptions& options) {
  const linear::OnProgress& tell = options.tell;
  Certificate result;
  result.feasibility = feasibility(scenario);
  result.start_range = start_range_of(scenario);
  if (scenario.loop.mode == scenario::Mode::realtime) result.max_missed = scenario.loop.max_missed;
  result.loop = analyse(
      scenario, options.full || result.max_missed ? linear::Effort::full : linear::Effort::margins,
      tell, options.answers);
  if (scenario.gives("plant.drive.loop") && result.loop.margins) {
    tell("loop inside the drives");
    result.drives = predict_drives(scenario, options.answers);
  }
  result.no_stability = no_region(result.loop);
  if (result.no_stability.empty() && lyapunov::has_error_form(scenario.controller.law)) {
    result.weighted = lyapunov::weighted_region(scenario, result.no_stability, tell);
  } else if (result.no_stability.empty()) {
    result.stability =
        lyapunov::stability_certificate(scenario, linear::Effort::full, result.no_stability, tell);
    if (result.stability) result.global = lyapunov::global_convergence(scenario);
    if (result.global && clips_feedforward(result.feasibility)) {
      result.global = {false, "feedforward_max clips the feed-forward at some posture", {}};
    }
  }
  if (options.full)
    result.nonlinear = lyapunov::sampled_region(scenario, result.no_nonlinear, tell);
  if (options.paper) {
    std::string why_not;
    result.paper = lyapunov::paper_conditions(scenario, why_not);
  }
  return result;
}

std::optional<lyapunov::CertifiedRun> certified_run(const scenario::Scenario& scenario) {
  if (!lyapunov::no_certificate(scenario).empty()) return {};
  if (!no_region(analyse(scenario, linear::Effort::quick)).empty()) return {};
  return lyapunov::certified_run(scenario);
}

std::vector<std::string> objections(const Certificate& certificate) {
  std::vector<std::string> all = certificate.feasibility.impossible;
  if (certificate.loop.unknown.empty() && !certificate.loop.stable) {
    all.insert(all.begin(), "the sampled loop is unstable at this period");
  }
  return all;
}

std::string page(const Certificate& certificate, const scenario::Scenario& scenario, bool full) {
  std::string text =
      fmt::format("{}: {}, h = {}, delay {}\n", scenario.name, scenario.controller.law_text(),
                  period_text(scenario.loop.period_s), scenario.loop.command_delay);
  const std::vector<Group> all = groups(certificate);
  if (!full) text += short_page(all);
  for (const Group& group : all) {
    if (!full && group.key != "paper") continue;
    text += fmt::format("\n{}\n", group.heading);
    for (const Entry& entry : group.entries) {
      if (!entry.label.empty()) text += fmt::format("  {:<34} {}\n", entry.label, entry.text);
    }
  }
  return text;
}

Json to_json(const Certificate& certificate) {
  Json json;
  for (const Group& group : groups(certificate)) json[std::string(group.key)] = json_of(group);
  return json;
}

Json to_json(const lyapunov::CertifiedStart& start) {
  return {{"certified", start.decided ? Json(start.certified) : Json()},
          {"proved", start.proved},
          {"torque_share", json_of(start.torque_share)}};
}

Json to_json(const Prediction& prediction) {
  Json json = json_of(loop_group(prediction));
  const std::string held = friction_text(prediction);
  json["text"] = text(prediction) + (held.empty() ? "" : "; " + held);
  return json;
}

}  // namespace tachless::certify
