#include "design/adaptation.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <string>
#include <string_view>
#include <vector>

#include "controller/law/loria_ortega_adaptive.h"
#include "controller/law/loria_ortega_rigid.h"
#include "controller/law/loria_ortega_scheduled.h"
#include "controller/registry.h"
#include "design/design_problem.h"
#include "lyapunov/weighted_region.h"
#include "reference/make_trajectory.h"
#include "robot/dynamics.h"

namespace tachless::design {
namespace {

using controller::law::LoriaOrtegaAdaptive;
using controller::law::LoriaOrtegaRigid;
using controller::law::LoriaOrtegaScheduled;
using Eigen::MatrixXd;
using messages::ReferencePoint;

/// Largest Yd Gamma Yd' over Kp of a kind of parameters, the mean of the joints.
constexpr double adaptation_share = 0.5;

/// A kind of unknown parameters: the names of its gains.
struct Kind {
  const char* rate;
  const char* bound;
};
constexpr std::array load_kinds{Kind{"gamma_mass", "mass_max"}, Kind{"gamma_moment", "moment_max"},
                                Kind{"gamma_inertia", "inertia_max"}};
constexpr Kind friction_kind{"gamma_friction", "friction_max"};

/// The gains of the adaptation, found for one scenario and the gains of its feedback.
class Adaptation {
 public:
  Adaptation(const scenario::Scenario& scenario, const Gains& feedback)
      : scenario_(scenario), gains_(feedback), model_(controller::rigid_model(scenario)) {
    const auto trajectory = reference::make_trajectory(scenario);
    const reference::Motion motion(scenario, trajectory);
    for (const double t_s : motion.instants(200)) references_.push_back(trajectory.at(t_s));
    for (const auto& [name, value] : scenario.controller.gains) {
      if (!gains_.contains(name) && !is_of_feedback(name)) {
        gains_[name] = value.size() == 1 ? each(value[0]) : value;
      }
    }
    if (std::ranges::none_of(load_kinds, [&](const Kind& kind) { return asked(kind); }) &&
        !asked(friction_kind)) {
      gains_["gamma_mass"] = each(1);
    }
    const DesignProblem constant(with_constant_estimates(scenario), {});
    const Vector inertia = constant.mean_inertia();
    bandwidth_ = follows() ? gains_.at("w")[0]
                           : gains_.at("kp").cwiseQuotient(inertia).cwiseSqrt().minCoeff();
  }

  /// Finds the rates.
  void find_rates() {
    for (const Kind& kind : load_kinds) {
      if (!asked(kind)) continue;
      const double share = share_of(kind);
      if (share > 0) gains_[kind.rate] = each(rounded(adaptation_share / share));
    }
    if (!asked(friction_kind)) return;
    // Joints that do not move learn nothing of their friction.
    Vector largest = each(0);
    for (const ReferencePoint& r : references_) {
      const Vector v_squared = r.v_ref.cwiseProduct(r.v_ref);
      largest = largest.cwiseMax(v_squared.cwiseQuotient(Vector(stiffness(r).diagonal())));
    }
    Vector& rate = gains_[friction_kind.rate] = each(0);
    for (Eigen::Index j = 0; j < rate.size(); ++j) {
      if (largest[j] > 0) rate[j] = rounded(adaptation_share / largest[j]);
    }
  }

  /// Finds eps_1 and eps_2, and the bound of the mass where none is given.
  /// @return whether V falls with them at every corner of the box
  bool find_weights() {
    const bool given = gains_.contains("mass_max") || !asked(load_kinds[0]);
    const std::vector<double> masses =
        given ? std::vector<double>{0} : std::vector<double>{5, 2, 1, 0.5, 0.2};
    for (const double mass : masses) {
      if (!given) gains_["mass_max"] = each(mass);
      for (double share = 1; share > 0.05; share /= 1.5) {
        set_weights(share, gains_);
        if (follows()) return true;  // no region is computed for these gains
        std::string why_not;
        if (falls_at_some() && lyapunov::weighted_region(with(gains_), why_not)) return true;
      }
    }
    if (!given) gains_["mass_max"] = each(masses.front());
    set_weights(1, gains_);
    return false;
  }

  [[nodiscard]] const Gains& gains() const { return gains_; }
  [[nodiscard]] bool follows() const { return gains_.contains("w"); }

 private:
  [[nodiscard]] Vector each(double value) const {
    return Vector::Constant(scenario_.num_joints, value);
  }
  static bool is_of_feedback(std::string_view name) {
    constexpr std::array<std::string_view, 6> all{"kp", "kd", "a", "b", "w", "damping"};
    return std::ranges::find(all, name) != all.end();
  }
  static double rounded(double value) { return design::rounded(value, 3); }

  [[nodiscard]] bool asked(const Kind& kind) const {
    const auto above_0 = [&](const char* name) {
      const auto found = gains_.find(name);
      return found != gains_.end() && (found->second.array() > 0).any();
    };
    return above_0(kind.rate) || above_0(kind.bound);
  }

  /// Returns Kp at a point of the reference.
  [[nodiscard]] MatrixXd stiffness(const ReferencePoint& r) const {
    if (!follows()) return Eigen::VectorXd(gains_.at("kp")).asDiagonal();
    return bandwidth_ * bandwidth_ * robot::mass_matrix(model_, r.q_ref);
  }

  /// Returns the largest Yd Yd' over Kp of a kind along the reference, the mean of the joints.
  [[nodiscard]] double share_of(const Kind& kind) const {
    Gains alone = gains_;
    for (const Kind& other : load_kinds) alone.erase(other.rate);
    alone[kind.rate] = each(1);
    set_weights(1, alone);
    const auto law = controller::make_law<LoriaOrtegaAdaptive>(with(alone));
    double largest = 0;
    for (const ReferencePoint& r : references_) {
      const MatrixXd Y = law.columns_at(r, {r.v_ref, r.a_ref});
      const MatrixXd of_Kp = stiffness(r).llt().solve(Y);
      largest = std::max(largest, Y.cwiseProduct(of_Kp).sum() / scenario_.num_joints);
    }
    return largest;
  }

  void set_weights(double share, Gains& gains) const {
    const double eps_1 = share * bandwidth_ / 5;
    gains["eps_1"] = each(rounded(eps_1));
    gains["eps_2"] = each(rounded(5 * eps_1 / gains.at("b").minCoeff()));
  }

  /// Returns whether V falls at a few postures and instants, which takes little time.
  [[nodiscard]] bool falls_at_some() const {
    constexpr int samples = 20;
    std::string why_not;
    const auto loop = lyapunov::form_loop(with(gains_), why_not);
    if (!loop) return false;
    std::vector<lyapunov::ErrorForm> forms;
    for (int k = 0; k < samples * loop->corners(); ++k) forms.push_back(loop->form(k));
    return lyapunov::region_of(forms, *loop->weights()).level > 0;
  }

  [[nodiscard]] scenario::Scenario with(const Gains& gains) const {
    scenario::Scenario scenario = scenario_;
    scenario.controller.gains = gains;
    return scenario;
  }

  const scenario::Scenario& scenario_;
  Gains gains_;
  robot::Model model_;
  std::vector<ReferencePoint> references_;
  double bandwidth_ = 0;  ///< of the slowest joint [rad/s]
};

}  // namespace

bool adapts(const scenario::Scenario& scenario) {
  return scenario.controller.law == LoriaOrtegaAdaptive::name;
}

scenario::Scenario with_constant_estimates(const scenario::Scenario& scenario) {
  scenario::Scenario constant = scenario;
  const auto w = scenario.controller.gains.find("w");
  const bool follows = w != scenario.controller.gains.end() && w->second[0] > 0;
  constant.controller.law = follows ? LoriaOrtegaScheduled::name : LoriaOrtegaRigid::name;
  constant.controller.gains = controller::gains_of_law(
      scenario.controller.gains, controller::law_facts(constant.controller.law));
  return constant;
}

void add_adaptation(const scenario::Scenario& scenario, Design& design) {
  Adaptation adaptation(scenario, design.gains);
  adaptation.find_rates();
  const bool falls = adaptation.find_weights();
  design.gains = adaptation.gains();
  if (falls) return;
  design.warnings.emplace_back(
      "no region is certified for the box of the unknown parameters: give a smaller box, as with "
      "--set controller.gains.mass_max=0.5, or stiffer gains");
}

}  // namespace tachless::design
