#include "certificate/certify.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "certificate/postures.h"
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

std::string line(std::string_view name, const std::string& value) {
  return fmt::format("  {:<34} {}\n", name, value);
}

std::string extreme(std::string_view name, const Extreme& x, std::string_view unit) {
  const std::string bound =
      x.proved ? fmt::format(" (proved bound {:.6g})", x.bound) : std::string();
  return line(name, fmt::format("{:.5g} {}{} at q = {}", x.value, unit, bound, list(x.q)));
}

std::string constants_text(const RobotConstants& c) {
  return "Constants of the robot, over all postures\n" +
         extreme("smallest eigenvalue of M", c.lambda_min_M, "kg m2") +
         extreme("largest eigenvalue of M", c.lambda_max_M, "kg m2") +
         extreme("k_c = sup |C(q,x)|", c.k_c, "kg m2") +
         extreme("k_s = sup |C' - C|", c.k_s, "kg m2") +
         extreme("k_y = sup |sym C|", c.k_y, "kg m2") + extreme("sup |g|", c.sup_g, "N m") +
         extreme("k_g = sup |dg/dq|", c.k_g, "N m/rad");
}

std::string interval(const Interval& x) { return fmt::format("{:.4g} … {:.4g}", x.low, x.high); }

std::string printed_text(const StabilityCertificate& s) {
  const PrintedConditions& p = s.printed;
  std::string text = "Conditions as printed (Loria and Ortega, 1995; one weight eps)\n";
  text += line("(7) b_i > … / beta_2", fmt::format("{:.5g}", p.eq7));
  text += line("(25) eps > … / beta_3", fmt::format("{:.5g}", p.eq25));
  text += line("(19), (20) eps <", fmt::format("{:.5g}, {:.5g}", p.eq19, p.eq20));
  text += line("(23) eps < gamma_1 …", fmt::format("{:.5g}", p.eq23));
  text += line("(24) eps < gamma_1 beta_1 …", fmt::format("{:.5g}", p.eq24));
  text += line("(27) eps <", fmt::format("{:.5g}", p.eq27));
  text += line("some eps", p.feasible ? "yes: " + interval(p.epsilon) : "no: infeasible");
  if (p.feasible) {
    text += line("(8) best c_1",
                 fmt::format("{:.4g}, with gamma_2 free {:.4g}", p.c1, s.printed_gamma_free.c1));
    text += line("(26) R", fmt::format("{:.4g}", p.eq26));
  }
  const ScalarCondition::Result& c = s.completed;
  text += line("completed scalar condition",
               c.feasible ? fmt::format("eps {}, rho up to {:.5g} (eps {:.4g})",
                                        interval(c.epsilon), c.rho, c.best_epsilon)
                          : "infeasible");
  return text;
}

std::string choice_text(std::string_view name, const std::optional<Choice>& choice) {
  if (!choice) return line(name, "nothing certified: no weights were found");
  const Certified& c = choice->certified;
  std::string text =
      line(name, fmt::format("eps_1 {:.4g} 1/s, eps_2 {:.4g}", c.weights.eps_1, c.weights.eps_2));
  text += line("  V decays at, the error at",
               c.rate > 0 ? fmt::format("{:.4g} 1/s, {:.4g} 1/s (small errors)", c.rate, c.rate / 2)
                          : "no rate");
  text += line("  region: rho, level, ball",
               fmt::format("{:.4g}, {:.4g} J, {:.4g} (rad and rad/s mixed)", c.region.rho,
                           c.region.level, c.region.ball));
  text += line("  e_i(0) up to, alone", list(c.region.e_at_rest));
  text += line("  edot_i(0) up to, alone", list(c.region.edot));
  text += line("  this scenario's initial state",
               fmt::format("V = {:.4g} J: {}", choice->initial.V,
                           choice->initial.certified ? "certified" : "not certified"));
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
  text += choice_text("two weights, fastest rate", s.fastest);
  if (!s.held) {
    text += choice_text("two weights, largest ball", s.largest);
    text += choice_text("one weight, largest ball", s.one_weight);
  }
  if (!s.trade_off.empty()) {
    text += line("trade-off: ball → rate of V", "");
    for (const TradeOff& t : s.trade_off) {
      text += line("", fmt::format("{:.4g} → {:.4g} 1/s", t.ball, t.rate));
    }
  }
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
                 fmt::format("torque at rest {:.4g}, moving {:.4g}, limit {}; speed {:.4g}, limit "
                             "{}; f h = {:.2g}",
                             joint.at_rest, joint.moving, limit(joint.torque_limit), joint.speed,
                             limit(joint.speed_limit), joint.cycles_per_tick));
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
  std::string text = line("spectral radius, slowest decay",
                          fmt::format("{:.6g}, {:.4g} 1/s", m.radius, m.decay_per_s));
  if (!s.along.empty()) {
    text += line("along the reference, per period", fmt::format("{:.6g}", s.radius_along));
  }
  if (m.stable) {
    text += line("settles to 1 % in", fmt::format("{:.3g} s", m.settling_s));
  }
  text += line("least damped mode",
               m.least_damping < 1
                   ? fmt::format("{:.4g} Hz, damping {:.3g}", m.least_damped_hz, m.least_damping)
                   : std::string("none oscillates"));
  text += line("slow poles", fmt::format("{} 1/s", list(m.slow_per_s)));
  const Margins& g = s.margins;
  text += line("gain, phase, delay margin",
               fmt::format("{:.3g}, {:.3g} deg, {}", g.gain, g.phase_deg,
                           std::isinf(g.delay_s) ? "any delay" : period_text(g.delay_s)));
  text += line("modulus margin", fmt::format("{:.3g} (common to all torques), {:.3g} (independent)",
                                             g.modulus, g.modulus_independent));
  return text;
}

std::string sampled_text(const Certificate& certificate) {
  if (!certificate.sampled) {
    return fmt::format("Sampled loop\n  not examined: the law cannot be linearised ({})\n",
                       certificate.no_sampled);
  }
  const SampledCertificate& s = *certificate.sampled;
  std::string text = "Sampled loop (linearised; sampled postures of the reference)\n";
  text += line("verdict", fmt::format("{} at h = {}, delay {}", s.stable ? "stable" : "UNSTABLE",
                                      period_text(s.settings.period_s), s.settings.delay));
  text += line("largest stable period",
               fmt::format("{} (at q = {})", limit_text(s.limit_s), list(s.limit_q)));
  text += line("at any posture",
               fmt::format("{} ({} sampled; at q = {})", limit_text(s.anywhere_limit_s),
                           s.anywhere_postures, list(s.anywhere_q)));
  for (const FilterLimits& f : s.limits) {
    const std::string_view name = s.has_filter ? schema::name_of(f.filter) : "no filter";
    text += line(
        fmt::format("  {}", name),
        fmt::format("delay 0: {}, delay 1: {}", limit_text(f.delay_0_s), limit_text(f.delay_1_s)));
  }
  text += margins_text(s);
  text += line("torque per angle", fmt::format("{} N m/rad", list(s.gain_Nm_per_rad)));
  if (s.count_Nm)
    text += line("torque per encoder count", fmt::format("{} N m", list(*s.count_Nm)));
  return text;
}

// ---- JSON ------------------------------------------------------------------------------------

Json number(double x) { return std::isfinite(x) ? Json(x) : Json(); }
Json number(const std::optional<double>& x) { return x ? number(*x) : Json(); }
template <class Vector>
Json array(const Vector& x) {
  Json all = Json::array();
  for (const double value : x) all.push_back(number(value));
  return all;
}

void add(Json& json, const RobotConstants& c) {
  const std::pair<const char*, const Extreme*> all[] = {{"lambda_min_M", &c.lambda_min_M},
                                                        {"lambda_max_M", &c.lambda_max_M},
                                                        {"k_c", &c.k_c},
                                                        {"k_s", &c.k_s},
                                                        {"k_y", &c.k_y},
                                                        {"k_g", &c.k_g},
                                                        {"sup_g", &c.sup_g}};
  Json values = Json::object(), found = Json::object();
  for (const auto& [name, x] : all) {
    values[name] = number(x->value);
    found[name] = {{"bound", number(x->bound)},
                   {"status", x->proved ? "proved" : "sampled"},
                   {"q", array(x->q)}};
  }
  json["constants"] = values;
  json["constants_found"] = found;
}

Json json_of(const Interval& x) { return {number(x.low), number(x.high)}; }

Json json_of(const PrintedConditions& p) {
  return {{"eq7", number(p.eq7)},
          {"eq19", number(p.eq19)},
          {"eq20", number(p.eq20)},
          {"eq23", number(p.eq23)},
          {"eq24", number(p.eq24)},
          {"eq25", number(p.eq25)},
          {"eq26", p.feasible ? number(p.eq26) : Json()},
          {"eq27", number(p.eq27)},
          {"feasible", p.feasible},
          {"epsilon", p.feasible ? json_of(p.epsilon) : Json()},
          {"c1", p.feasible ? number(p.c1) : Json()}};
}

Json json_of(const std::optional<Choice>& choice) {
  if (!choice) return {};
  const Certified& c = choice->certified;
  return {{"epsilon_1", number(c.weights.eps_1)},
          {"epsilon_2", number(c.weights.eps_2)},
          {"rate_per_s", number(c.rate)},
          {"error_rate_per_s", number(c.rate / 2)},
          {"rho", number(c.region.rho)},
          {"level", number(c.region.level)},
          {"ball", number(c.region.ball)},
          {"e_at_rest", array(c.region.e_at_rest)},
          {"edot", array(c.region.edot)},
          {"initial_state",
           {{"V", number(choice->initial.V)}, {"certified", choice->initial.certified}}}};
}

void add(Json& json, const StabilityCertificate& s) {
  const char* status = s.proved ? "proved" : "sampled";
  json["B_d"] = number(s.B_d);
  json["printed"] = json_of(s.printed);
  json["printed"]["c1_gamma_2_free"] =
      s.printed_gamma_free.feasible ? number(s.printed_gamma_free.c1) : Json();
  json["completed"] = {{"feasible", s.completed.feasible},
                       {"epsilon", s.completed.feasible ? json_of(s.completed.epsilon) : Json()},
                       {"rho", s.completed.feasible ? number(s.completed.rho) : Json()}};
  Json matrix = {{"feasible", s.held || s.one_weight.has_value()}};
  if (s.one_weight) {
    matrix.update(json_of(s.one_weight));
    matrix["epsilon"] = matrix["epsilon_2"];
    // Of |e - nu|, as the one-weight condition is written.
    matrix["rho"] =
        number(s.one_weight->certified.region.rho / s.one_weight->certified.weights.eps_2);
    matrix.erase("epsilon_1");
    matrix.erase("epsilon_2");
  }
  matrix["status"] = status;
  json["matrix"] = matrix;
  const std::optional<Choice>& of_state = s.largest ? s.largest : s.fastest;
  json["two_weights"] = {{"feasible", s.fastest || s.largest},
                         {"fastest", json_of(s.fastest)},
                         {"largest", json_of(s.largest)},
                         {"initial_state", of_state ? json_of(of_state)["initial_state"] : Json()},
                         {"status", status}};
  Json& curve = json["two_weights"]["trade_off"] = Json::array();
  for (const TradeOff& t : s.trade_off) {
    curve.push_back({{"ball", number(t.ball)}, {"rate_per_s", number(t.rate)}});
  }
  json["held_reference"] = s.held;
  json["provisos"] = s.provisos;
}

void add(Json& json, const Feasibility& f) {
  Json joints = Json::array();
  for (const JointDemand& joint : f.joints) {
    joints.push_back({{"name", joint.name},
                      {"torque_at_rest", number(joint.at_rest)},
                      {"torque_moving", number(joint.moving)},
                      {"torque_limit", number(joint.torque_limit)},
                      {"speed", number(joint.speed)},
                      {"speed_limit", number(joint.speed_limit)},
                      {"cycles_per_tick", number(joint.cycles_per_tick)}});
  }
  json["feasibility"] = {
      {"joints", joints}, {"impossible", f.impossible}, {"doubtful", f.doubtful}};
}

void add(Json& json, const SampledCertificate& s) {
  Json limits = Json::object();
  for (const FilterLimits& f : s.limits) {
    limits[s.has_filter ? std::string(schema::name_of(f.filter)) : "no_filter"] = {
        {"delay_0", number(f.delay_0_s)}, {"delay_1", number(f.delay_1_s)}};
  }
  json["sampled"] = {
      {"period_s", s.settings.period_s},
      {"delay", s.settings.delay},
      {"stable", s.stable},
      {"limit_s", number(s.limit_s)},
      {"limit_q", array(s.limit_q)},
      {"anywhere_limit_s", number(s.anywhere_limit_s)},
      {"limits_s", limits},
      {"spectral_radius", number(s.modes.radius)},
      {"spectral_radius_along", number(s.radius_along)},
      {"settling_s", number(s.modes.settling_s)},
      {"least_damped",
       {{"hz", number(s.modes.least_damped_hz)}, {"damping", number(s.modes.least_damping)}}},
      {"margins",
       {{"modulus", number(s.margins.modulus)},
        {"modulus_independent", number(s.margins.modulus_independent)},
        {"gain", number(s.margins.gain)},
        {"phase_deg", number(s.margins.phase_deg)},
        {"delay_s", number(s.margins.delay_s)}}}};
  json["noise"] = {{"gain_Nm_per_rad", array(s.gain_Nm_per_rad)},
                   {"count_torque_Nm", s.count_Nm ? array(*s.count_Nm) : Json()}};
  json["slow_pole_per_s"] = array(s.modes.slow_per_s);
}

}  // namespace

std::string period_text(double seconds) {
  if (seconds >= 1) return fmt::format("{:.4g} s", seconds);
  if (seconds >= 1e-3) return fmt::format("{:.4g} ms", 1e3 * seconds);
  return fmt::format("{:.4g} µs", 1e6 * seconds);
}

Certificate certify(const experiment::Scenario& scenario, const OnProgress& on_progress) {
  Certificate result;
  result.feasibility = feasibility(scenario);
  result.no_sampled = controller::law_facts(scenario.controller.law).no_linearisation;
  result.sampled = sampled_certificate(scenario, on_progress);
  if (on_progress) on_progress("constants of the robot");
  const robot::Model model = error_model(scenario);
  result.constants = robot_constants(model, Postures(model));
  result.stability =
      stability_certificate(scenario, result.constants, result.no_stability, on_progress);
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
