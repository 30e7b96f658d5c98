#include "certificate/certify.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "controller/registry.h"
#include "schema/schema.h"

namespace tachless::certificate {
namespace {

using Json = nlohmann::ordered_json;

// ---- for people ------------------------------------------------------------------------------

template <class Vector>
std::string list(const Vector& x) {
  return fmt::format("[{:.4g}]", fmt::join(x.begin(), x.end(), ", "));
}

template <class... T>
std::string line(std::string_view name, fmt::format_string<T...> form, const T&... values) {
  return fmt::format("  {:<34} {}\n", name, fmt::vformat(form, fmt::make_format_args(values...)));
}

std::string constants_text(const RobotConstants& c) {
  std::string text = "Constants of the robot, over all postures\n";
  const auto add = [&](const char* name, const Constant& x, const char* unit) {
    const std::string bound =
        x.proved ? fmt::format(" (proved bound {:.6g})", x.bound) : std::string();
    text += line(name, "{:.5g} {}{} at q = {}", x.value, unit, bound, list(x.q));
  };
  add("smallest eigenvalue of M", c.lambda_min_M, "kg m2");
  add("largest eigenvalue of M", c.lambda_max_M, "kg m2");
  add("k_c = sup |C(q,x)|", c.k_c, "kg m2");
  add("k_s = sup |C' - C|", c.k_s, "kg m2");
  add("k_y = sup |sym C|", c.k_y, "kg m2");
  add("sup |g|", c.sup_g, "N m");
  add("k_g = sup |dg/dq|", c.k_g, "N m/rad");
  return text;
}

std::string interval(const Interval& x) { return fmt::format("{:.4g} … {:.4g}", x.low, x.high); }

std::string printed_text(const StabilityCertificate& s) {
  const PrintedConditions& p = s.printed;
  std::string text = "Conditions as printed (Loria and Ortega, 1995; one weight eps)\n";
  text += line("(7) b_i > … / beta_2", "{:.5g}", p.eq7);
  text += line("(25) eps > … / beta_3", "{:.5g}", p.eq25);
  text += line("(19), (20) eps <", "{:.5g}, {:.5g}", p.eq19, p.eq20);
  text += line("(23) eps < gamma_1 …", "{:.5g}", p.eq23);
  text += line("(24) eps < gamma_1 beta_1 …", "{:.5g}", p.eq24);
  text += line("(27) eps <", "{:.5g}", p.eq27);
  text += line("some eps", "{}", p.feasible ? "yes: " + interval(p.epsilon) : "no: infeasible");
  if (p.feasible) {
    text += line("(8) best c_1", "{:.4g}, with gamma_2 free {:.4g}", p.c1, s.printed_gamma_free.c1);
    text += line("(26) R", "{:.4g}", p.eq26);
  }
  const ScalarCondition::Result& c = s.completed;
  text += line("completed scalar condition", "{}",
               c.feasible ? fmt::format("eps {}, rho up to {:.5g} (eps {:.4g})",
                                        interval(c.epsilon), c.rho, c.best_epsilon)
                          : "infeasible");
  return text;
}

std::string weights_text(std::string_view name, const std::optional<Certified>& c) {
  if (!c) return line(name, "nothing certified: no weights were found");
  const Region& region = c->region;
  std::string text =
      line(name, "eps_1 {:.4g} 1/s, eps_2 {:.4g}", c->weights.eps_1, c->weights.eps_2);
  text +=
      line("  V decays at, the error at", "{}",
           c->rate > 0 ? fmt::format("{:.4g} 1/s, {:.4g} 1/s (small errors)", c->rate, c->rate / 2)
                       : "no rate");
  text += line("  region: rho, level, ball", "{:.4g}, {:.4g} J, {:.4g} (rad and rad/s mixed)",
               region.rho, region.level, region.ball);
  text += line("  e_i(0) up to, alone", "{}", list(region.e_at_rest));
  text += line("  edot_i(0) up to, alone", "{}", list(region.edot));
  text += line("  this scenario's initial state", "V = {:.4g} J: {}", c->V0,
               c->holds_initial_state() ? "certified" : "not certified");
  return text;
}

std::string stability_text(const Certificate& all) {
  if (!all.stability) {
    return fmt::format("Stability certificate\n  none: {}\n", all.no_stability);
  }
  const StabilityCertificate& s = *all.stability;
  std::string text = printed_text(s);
  text += fmt::format(
      "\nMatrix condition ({}; sup |v_ref| = {:.5g})\n",
      s.proved ? "proved: between grid points it is bounded" : "sampled postures: not a proof",
      s.B_d);
  if (s.held) {
    text += line("constant reference",
                 "asymptotically stable for any positive gains, both weights 0 (LaSalle)");
  }
  text += weights_text("two weights, fastest rate", s.fastest);
  if (!s.held) {
    text += weights_text("two weights, largest ball", s.largest);
    text += weights_text("one weight, largest ball", s.one_weight);
  }
  if (!s.trade_off.empty()) text += line("trade-off: ball → rate of V", "");
  for (const TradeOff& t : s.trade_off) text += line("", "{:.4g} → {:.4g} 1/s", t.ball, t.rate);
  text +=
      "  It holds in continuous time, with an exact model, without saturation, quantisation, delay "
      "or lead.\n";
  for (const std::string& proviso : s.provisos) text += fmt::format("  Proviso: {}.\n", proviso);
  return text;
}

std::string feasibility_text(const Feasibility& f) {
  std::string text = "What the reference asks for (errors come on top)\n";
  const auto limit = [](const std::optional<double>& value) {
    return value ? fmt::format("{:g}", *value) : std::string("none");
  };
  for (const JointDemand& joint : f.joints) {
    text += line(joint.name,
                 "torque at rest {:.4g}, moving {:.4g}, limit {}; speed {:.4g}, limit {}; f h = "
                 "{:.2g}",
                 joint.at_rest, joint.moving, limit(joint.torque_limit), joint.speed,
                 limit(joint.speed_limit), joint.cycles_per_tick);
  }
  for (const std::string& problem : f.impossible)
    text += fmt::format("  IMPOSSIBLE: {}.\n", problem);
  for (const std::string& doubt : f.doubtful) text += fmt::format("  Doubtful: {}.\n", doubt);
  return text;
}

std::string limit_text(const std::optional<double>& limit) {
  if (!limit) return "unstable at any";
  return *limit >= 1 ? "none up to 1 s" : period_text(*limit);
}

std::string margins_text(const SampledCertificate& s) {
  const Modes& m = s.modes;
  const Margins& g = s.margins;
  std::string text =
      line("spectral radius, slowest decay", "{:.6g}, {:.4g} 1/s", m.radius, m.decay_per_s);
  if (!s.along.empty()) text += line("along the reference, per period", "{:.6g}", s.radius_along);
  if (m.stable) text += line("settles to 1 % in", "{:.3g} s", m.settling_s);
  text += line("least damped mode", "{}",
               m.least_damping < 1
                   ? fmt::format("{:.4g} Hz, damping {:.3g}", m.least_damped_hz, m.least_damping)
                   : "none oscillates");
  text += line("slow poles", "{} 1/s", list(m.slow_per_s));
  text += line("gain, phase, delay margin", "{:.3g}, {:.3g} deg, {}", g.gain, g.phase_deg,
               std::isinf(g.delay_s) ? "any delay" : period_text(g.delay_s));
  text += line("modulus margin", "{:.3g} (common to all torques), {:.3g} (independent)", g.modulus,
               g.modulus_independent);
  return text;
}

std::string sampled_text(const Certificate& certificate) {
  if (!certificate.sampled) {
    return fmt::format("Sampled loop\n  not examined: the law cannot be linearised ({})\n",
                       certificate.no_sampled);
  }
  const SampledCertificate& s = *certificate.sampled;
  std::string text = "Sampled loop (linearised; sampled postures of the reference)\n";
  text += line("verdict", "{} at h = {}, delay {}", s.stable ? "stable" : "UNSTABLE",
               period_text(s.settings.period_s), s.settings.command_delay);
  text += line("largest stable period", "{} (at q = {})", limit_text(s.limit_s), list(s.limit_q));
  text += line("at any posture", "{} ({} sampled; at q = {})", limit_text(s.anywhere_limit_s),
               s.anywhere_postures, list(s.anywhere_q));
  for (const FilterLimits& f : s.limits) {
    const std::string_view name = s.has_filter ? schema::name_of(f.filter) : "no filter";
    text += line(fmt::format("  {}", name), "delay 0: {}, delay 1: {}", limit_text(f.delay_0_s),
                 limit_text(f.delay_1_s));
  }
  text += margins_text(s);
  text += line("torque per angle", "{} N m/rad", list(s.gain_Nm_per_rad));
  if (s.count_Nm) text += line("torque per encoder count", "{} N m", list(*s.count_Nm));
  return text;
}

// ---- JSON: what is not finite is written as null ---------------------------------------------

Json json_of(const std::optional<double>& x) { return x ? Json(*x) : Json(); }
Json json_of(const Interval& x) { return {x.low, x.high}; }
template <class Vector>
Json array(const Vector& x) {
  return std::vector<double>(x.begin(), x.end());
}

void add(Json& json, const RobotConstants& c) {
  const std::pair<const char*, const Constant*> all[] = {{"lambda_min_M", &c.lambda_min_M},
                                                         {"lambda_max_M", &c.lambda_max_M},
                                                         {"k_c", &c.k_c},
                                                         {"k_s", &c.k_s},
                                                         {"k_y", &c.k_y},
                                                         {"k_g", &c.k_g},
                                                         {"sup_g", &c.sup_g}};
  Json values, found;
  for (const auto& [name, x] : all) {
    values[name] = x->value;
    found[name] = {
        {"bound", x->bound}, {"status", x->proved ? "proved" : "sampled"}, {"q", array(x->q)}};
  }
  json["constants"] = values;
  json["constants_found"] = found;
}

Json json_of(const std::optional<Certified>& c) {
  if (!c) return {};
  return {{"epsilon_1", c->weights.eps_1},
          {"epsilon_2", c->weights.eps_2},
          {"rate_per_s", c->rate},
          {"error_rate_per_s", c->rate / 2},
          {"rho", c->region.rho},
          {"level", c->region.level},
          {"ball", c->region.ball},
          {"e_at_rest", array(c->region.e_at_rest)},
          {"edot", array(c->region.edot)},
          {"initial_state", {{"V", c->V0}, {"certified", c->holds_initial_state()}}}};
}

void add(Json& json, const StabilityCertificate& s) {
  const char* status = s.proved ? "proved" : "sampled";
  const auto if_feasible = [](bool feasible, const auto& value) {
    return feasible ? Json(value) : Json();
  };
  const PrintedConditions &p = s.printed, &free = s.printed_gamma_free;
  json["B_d"] = s.B_d;
  json["printed"] = {{"eq7", p.eq7},
                     {"eq19", p.eq19},
                     {"eq20", p.eq20},
                     {"eq23", p.eq23},
                     {"eq24", p.eq24},
                     {"eq25", p.eq25},
                     {"eq26", if_feasible(p.feasible, p.eq26)},
                     {"eq27", p.eq27},
                     {"feasible", p.feasible},
                     {"epsilon", if_feasible(p.feasible, json_of(p.epsilon))},
                     {"c1", if_feasible(p.feasible, p.c1)},
                     {"c1_gamma_2_free", if_feasible(free.feasible, free.c1)}};
  const ScalarCondition::Result& c = s.completed;
  json["completed"] = {{"feasible", c.feasible},
                       {"epsilon", if_feasible(c.feasible, json_of(c.epsilon))},
                       {"rho", if_feasible(c.feasible, c.rho)}};
  Json& matrix = json["matrix"] = {{"feasible", s.held || s.one_weight.has_value()}};
  if (s.one_weight) {
    matrix.update(json_of(s.one_weight));
    matrix["epsilon"] = matrix["epsilon_2"];
    // Of |e - nu|, as the one-weight condition is written.
    matrix["rho"] = s.one_weight->region.rho / s.one_weight->weights.eps_2;
    matrix.erase("epsilon_1");
    matrix.erase("epsilon_2");
  }
  matrix["status"] = status;
  const std::optional<Certified>& of_state = s.largest ? s.largest : s.fastest;
  Json curve = Json::array();
  for (const TradeOff& t : s.trade_off) {
    curve.push_back({{"ball", t.ball}, {"rate_per_s", t.rate}});
  }
  json["two_weights"] = {{"feasible", s.fastest || s.largest},
                         {"fastest", json_of(s.fastest)},
                         {"largest", json_of(s.largest)},
                         {"initial_state", of_state ? json_of(of_state)["initial_state"] : Json()},
                         {"status", status},
                         {"trade_off", curve}};
  json["held_reference"] = s.held;
  json["provisos"] = s.provisos;
}

void add(Json& json, const Feasibility& f) {
  Json joints = Json::array();
  for (const JointDemand& joint : f.joints) {
    joints.push_back({{"name", joint.name},
                      {"torque_at_rest", joint.at_rest},
                      {"torque_moving", joint.moving},
                      {"torque_limit", json_of(joint.torque_limit)},
                      {"speed", joint.speed},
                      {"speed_limit", json_of(joint.speed_limit)},
                      {"cycles_per_tick", joint.cycles_per_tick}});
  }
  json["feasibility"] = {
      {"joints", joints}, {"impossible", f.impossible}, {"doubtful", f.doubtful}};
}

void add(Json& json, const SampledCertificate& s) {
  Json limits = Json::object();
  for (const FilterLimits& f : s.limits) {
    limits[s.has_filter ? std::string(schema::name_of(f.filter)) : "no_filter"] = {
        {"delay_0", json_of(f.delay_0_s)}, {"delay_1", json_of(f.delay_1_s)}};
  }
  const Modes& m = s.modes;
  const Margins& g = s.margins;
  json["sampled"] = {{"period_s", s.settings.period_s},
                     {"delay", s.settings.command_delay},
                     {"stable", s.stable},
                     {"limit_s", json_of(s.limit_s)},
                     {"limit_q", array(s.limit_q)},
                     {"anywhere_limit_s", json_of(s.anywhere_limit_s)},
                     {"limits_s", limits},
                     {"spectral_radius", m.radius},
                     {"spectral_radius_along", s.radius_along},
                     {"settling_s", m.settling_s},
                     {"least_damped", {{"hz", m.least_damped_hz}, {"damping", m.least_damping}}},
                     {"margins",
                      {{"modulus", g.modulus},
                       {"modulus_independent", g.modulus_independent},
                       {"gain", g.gain},
                       {"phase_deg", g.phase_deg},
                       {"delay_s", g.delay_s}}}};
  json["noise"] = {{"gain_Nm_per_rad", array(s.gain_Nm_per_rad)},
                   {"count_torque_Nm", s.count_Nm ? array(*s.count_Nm) : Json()}};
  json["slow_pole_per_s"] = array(m.slow_per_s);
}

}  // namespace

Certificate certify(const experiment::Scenario& scenario, const OnProgress& tell) {
  Certificate result;
  result.feasibility = feasibility(scenario);
  result.no_sampled = controller::law_facts(scenario.controller.law).no_linearisation;
  result.sampled = sampled_certificate(scenario, tell);
  tell("constants of the robot");
  const robot::Model model = error_model(scenario);
  result.constants = robot_constants(model, Postures(model));
  result.stability = stability_certificate(scenario, result.constants, result.no_stability, tell);
  return result;
}

std::vector<std::string> objections(const Certificate& certificate) {
  std::vector<std::string> all = certificate.feasibility.impossible;
  if (certificate.sampled && !certificate.sampled->stable) {
    all.insert(all.begin(), "the sampled loop is unstable at this period");
  }
  return all;
}

std::string page(const Certificate& certificate, const experiment::Scenario& scenario) {
  return fmt::format("{}: {}, h = {}, delay {}\n\n{}\n{}\n{}\n{}", scenario.name,
                     scenario.controller.law, period_text(scenario.loop.period_s),
                     scenario.loop.command_delay, sampled_text(certificate),
                     feasibility_text(certificate.feasibility), stability_text(certificate),
                     constants_text(certificate.constants));
}

Json to_json(const Certificate& certificate) {
  Json json;
  add(json, certificate.constants);
  if (certificate.stability) {
    add(json, *certificate.stability);
  } else {
    json["no_stability_certificate"] = certificate.no_stability;
  }
  if (certificate.sampled) {
    add(json, *certificate.sampled);
  } else {
    json["no_sampled_certificate"] = certificate.no_sampled;
  }
  add(json, certificate.feasibility);
  return json;
}

}  // namespace tachless::certificate
