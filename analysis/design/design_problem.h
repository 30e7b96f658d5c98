#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "controller/registry.h"
#include "design/design.h"
#include "design/gain_search.h"
#include "design/uncertainty.h"
#include "linear/scenario_loop.h"

namespace tachless::design {

using linear::ScenarioLoop;

using Gains = std::map<std::string, Vector>;

/// Returns the number rounded to `digits` significant digits.
double rounded(double value, int digits);

/// The gains of a scenario's law as the variables of a search: which gains vary, their start and
/// their bounds. The class also computes the law's feedback terms as a function of the variables.
class DesignProblem {
 public:
  /// @param answers answers of an external law, which has the scenario's gains; empty: the law is
  /// in the catalogue
  /// @throw base::Failure(check_said_no) for a law without a rule of thumb
  DesignProblem(const scenario::Scenario& scenario, const DesignGoal& goal,
                const linear::LawAnswers& answers = {});

  /// Chooses the gains that vary. Call it before all functions below except `by_rule`. The law must
  /// have a linearisation.
  /// @throw base::Failure(check_said_no) for a law without gains
  void choose_variables();

  struct RuleOptions {
    double damping = 1;  ///< damping of the two poles
    /// Inertia of each joint: 0 takes the inertia with the other joints free, 1 with the other
    /// joints held. Values between interpolate.
    double held = 0;
    /// True: kd b is split so that b = 1 / h. False: b = a, and v_ref + nu approximates the
    /// velocity.
    bool one_b = true;
  };
  /// Returns the gains by the rule of thumb. Filters are r times as fast as the two poles and no
  /// faster than 1 / h.
  [[nodiscard]] Gains by_rule(double w, double r, const RuleOptions& options) const;
  [[nodiscard]] Gains by_rule(double w, double r) const { return by_rule(w, r, {}); }
  /// Returns the gains for the variables `theta`.
  [[nodiscard]] Gains gains(const Eigen::VectorXd& theta) const;
  /// Rounds gains to four digits. Leaves the matrices of an external law, which do not vary,
  /// unchanged.
  [[nodiscard]] Gains rounded(Gains all) const;
  /// Returns the variables for `gains`.
  [[nodiscard]] Eigen::VectorXd theta_of(const Gains& gains) const;
  /// Returns theta of the scenario's own gains, or nothing when the scenario lacks a gain that
  /// varies.
  [[nodiscard]] std::optional<Eigen::VectorXd> own_theta() const;
  /// Returns further starts of the search for an external law. Each is `theta` with all numbers of
  /// one gain doubled or halved.
  [[nodiscard]] std::vector<Eigen::VectorXd> beside(const Eigen::VectorXd& theta) const;
  /// Returns the gains for half the bandwidth, or nothing for an external law.
  [[nodiscard]] std::optional<Eigen::VectorXd> softer(const Eigen::VectorXd& theta) const;
  /// Returns the feedback terms about rest in a posture.
  [[nodiscard]] linear::LinearLaw feedback_at(const Gains& gains,
                                              const messages::ReferencePoint& rest) const;
  /// @param plant plant in place of the scenario's plant; null: the scenario's plant
  /// @param once true if the caller evaluates the loop's moduli only once, at few frequencies
  [[nodiscard]] RestLoop loop_at(const messages::ReferencePoint& rest,
                                 const UncertainPlant* plant = nullptr, bool once = false) const;
  /// Returns the problem that demands the margin at these postures. The result refers to this
  /// object.
  [[nodiscard]] GainProblem at(const std::vector<messages::ReferencePoint>& rests) const;

  /// Returns the upper bounds of theta for gains with a bandwidth of at most `hz`.
  [[nodiscard]] Eigen::VectorXd upper_within(double hz) const;

  [[nodiscard]] scenario::Scenario with(const Gains& gains) const;
  /// Returns some postures of the reference. Settling is judged at the first few of them.
  [[nodiscard]] const std::vector<messages::ReferencePoint>& first_rests() const { return rests_; }
  [[nodiscard]] const linear::ScenarioLoop& loop() const { return loop_; }
  [[nodiscard]] const robot::Model& model() const { return model_; }
  [[nodiscard]] const Vector& mean_inertia() const { return mean_.inertia; }
  /// Returns a text such as "kp of joint 2 (elbow)".
  [[nodiscard]] std::string name_of(std::size_t variable) const;

 private:
  void choose_entries();
  void scale(Gains& gains, std::size_t kind, double factor) const;
  void bound_poles();
  void set_bounds();
  /// Sets the gains that follow from other gains by the rule of thumb. These are b of a law without
  /// gains of each joint, and an integral's gains for the slowest joint.
  void follow(Gains& all) const;
  [[nodiscard]] double rate() const { return 1 / scenario_.loop.period_s; }
  [[nodiscard]] Eigen::Index per_kind() const;
  [[nodiscard]] linear::Feedback feedback(const Eigen::VectorXd& theta,
                                          const messages::ReferencePoint& rest,
                                          bool derivatives) const;

  const scenario::Scenario& scenario_;
  DesignGoal goal_;
  const controller::LawFacts& law_;
  robot::Model model_;
  controller::law::Tuning mean_;  ///< tuning with the mean inertias
  Vector held_inertia_;           ///< mean of M_jj
  Matrix mean_matrix_;            ///< mean of M
  std::vector<messages::ReferencePoint> rests_;
  std::vector<std::string> kinds_;  ///< names of the gains that vary
  /// For an external law: the entry that varies, for each of kinds_; -1: all entries, which are
  /// equal.
  std::vector<Eigen::Index> entries_;
  bool has_own_gains_ = true;  ///< the law has gains of each joint
  bool by_joint_ = true;  ///< each joint's gains are variables; otherwise one factor for all joints
  linear::ScenarioLoop loop_;  ///< with initial gains; uses the members above
  Gains start_;
  GainProblem problem_;
};

/// Checks that design can work with the scenario's law.
/// @throw base::Failure(check_said_no) when it cannot
void require_rule(const scenario::Scenario& scenario);

inline constexpr int mean_postures = 16;  ///< postures in the joints' range for mean inertias
/// Returns rest in posture number `k` of a sequence within the joints' limits.
messages::ReferencePoint rest_in_range(const robot::Model& model, int k);

}  // namespace tachless::design
