#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "controller/registry.h"
#include "design/design.h"
#include "design/gain_search.h"
#include "linear/scenario_loop.h"

namespace tachless::design {

using linear::ScenarioLoop;

using Gains = std::map<std::string, Vector>;

/// A scenario's law as the variables of a search for its gains: which gains vary, from where, in
/// which bounds, and the law's feedback terms as a function of them.
class DesignProblem {
 public:
  /// @param answers of an external law, whose gains are the scenario's
  /// @throw base::Failure(check_said_no) for a law without a rule.
  DesignProblem(const scenario::Scenario& scenario, const DesignGoal& goal,
                const linear::LawAnswers& answers = {});

  /// To be called before what follows but for `by_rule`; of a law that can be linearised.
  /// @throw base::Failure(check_said_no) for a law without gains
  void choose_variables();

  /// By the rule of thumb, filters r times as fast as the two poles and no faster than 1 / h.
  /// @param held from 0 to 1: from the inertia of a joint when the others are free to that when
  /// they are held
  /// @param one_b kd b is split so that b = 1 / h; else b = a, and v_ref + nu is about the velocity
  [[nodiscard]] Gains by_rule(double w, double r, double damping = 1, bool one_b = true,
                              double held = 0) const;
  [[nodiscard]] Gains gains(const Eigen::VectorXd& theta) const;
  /// To four digits; an external law's matrices, which do not vary, as they are.
  [[nodiscard]] Gains rounded(Gains all) const;
  [[nodiscard]] Eigen::VectorXd theta_of(const Gains& gains) const;
  /// The scenario's own gains; none where it lacks one that varies.
  [[nodiscard]] std::optional<Eigen::VectorXd> own_theta() const;
  /// Of an external law starts beside theta: all numbers of one gain times two, or half.
  [[nodiscard]] std::vector<Eigen::VectorXd> beside(const Eigen::VectorXd& theta) const;
  /// The feedback terms about rest in a posture.
  [[nodiscard]] linear::LinearLaw feedback_at(const Gains& gains,
                                              const messages::ReferencePoint& rest) const;
  /// To be solved with the margin kept at these postures. Refers to this.
  [[nodiscard]] GainProblem at(const std::vector<messages::ReferencePoint>& rests) const;

  [[nodiscard]] scenario::Scenario with(const Gains& gains) const;
  /// Some of the reference; settling is judged at the first of them.
  [[nodiscard]] const std::vector<messages::ReferencePoint>& first_rests() const { return rests_; }
  [[nodiscard]] const linear::ScenarioLoop& loop() const { return loop_; }
  [[nodiscard]] const robot::Model& model() const { return model_; }
  [[nodiscard]] const Vector& mean_inertia() const { return mean_.inertia; }
  /// "kp of joint 2 (elbow)".
  [[nodiscard]] std::string name_of(std::size_t variable) const;

 private:
  void choose_entries();
  void scale(Gains& gains, std::size_t kind, double factor) const;
  void bound_poles();
  void set_bounds();
  /// Gains that others determine: b of a law without gains of each joint, and an integral's, by the
  /// rule for the slowest joint.
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
  controller::law::Tuning mean_;  ///< with the mean inertias
  Vector held_inertia_;           ///< mean of M_jj
  Matrix mean_matrix_;            ///< of M
  std::vector<messages::ReferencePoint> rests_;
  std::vector<std::string> kinds_;  ///< names of the gains that vary
  /// Of an external law: which entry of each kind; -1: all of them, which are the same.
  std::vector<Eigen::Index> entries_;
  bool has_own_gains_ = true;  ///< of each joint
  bool by_joint_ = true;       ///< each joint's of its own; otherwise one factor for all
  linear::ScenarioLoop loop_;  ///< with gains of the rule, which looks at the members above
  Gains start_;
  GainProblem problem_;
};

/// Of a law of the catalogue: that design can work with it.
/// @throw base::Failure(check_said_no)
void require_rule(const scenario::Scenario& scenario);

inline constexpr int mean_postures = 16;  ///< in the joints' range, of mean inertias
/// At rest in number `k` of a sequence within the joints' limits, where they have some.
messages::ReferencePoint rest_in_range(const robot::Model& model, int k);

}  // namespace tachless::design
