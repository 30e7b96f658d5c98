#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "design/gain_search.h"

/// The problem of a search for gains at one point, and the linear programme about that point.
namespace tachless::design {

using linear::FeedbackAt;
using linear::settled;
using numerics::LinearProgramme;

// Price of a lack of margin, in logarithms of the error: a lack of 0.08 outweighs the whole fall to
// 1 %, which is 4.6.
constexpr double price_of_margin = 60;
constexpr double margin_kept = 0.003;  // added to the margin for dips between the frequencies
// Time for which errors are examined, as a multiple of T.
constexpr double window = 3;
constexpr double near_margin = 0.3;  // distance above the margin within which eigenvalues get rows

/// Least moduli of loops with given gains. The law's response is computed once where it is the same
/// at all postures.
class LeastModulus {
 public:
  LeastModulus(const GainProblem& problem, const Eigen::VectorXd& theta);
  /// Returns the least modulus of the loop at `rest`, or a smaller number above `enough`.
  /// @param among frequencies; empty: all
  [[nodiscard]] double at(const linear::RestLoop& loop, const messages::ReferencePoint& rest,
                          double enough, const std::vector<double>& among = {}) const;
  /// Returns the frequencies at which the modulus is near its least.
  [[nodiscard]] std::vector<double> lowest(const linear::RestLoop& loop,
                                           const messages::ReferencePoint& rest) const;

 private:
  [[nodiscard]] std::vector<FeedbackAt> grid(const linear::RestLoop& loop,
                                             const messages::ReferencePoint& rest,
                                             const std::vector<double>& among) const;

  const GainProblem* problem_;
  Eigen::VectorXd theta_;
  std::vector<FeedbackAt> grid_;  ///< empty: it depends on the loop
};

/// Logarithm of a joint's torque per encoder count over the largest allowed torque, and the joint.
struct Lack {
  double lack = 0;
  std::size_t joint = 0;
};

/// Problem of a search for gains, evaluated at one theta.
class GainPoint {
 public:
  GainPoint(const GainProblem& problem, const Eigen::VectorXd& theta);
  /// Computes the moduli. Call it before asking for moduli or programmes. A lower bound replaces a
  /// modulus that exceeds the margin by more than `near_margin`.
  void look_at_margins();
  void differentiate();  ///< call it before asking for a programme

  [[nodiscard]] const Eigen::VectorXd& theta() const { return theta_; }
  [[nodiscard]] Eigen::Index num_joints() const { return feedback_[0].law.D.rows(); }
  /// Returns the least modulus of a loop, divided by the loop's share of the margin.
  [[nodiscard]] double least_modulus(std::size_t loop) const;
  [[nodiscard]] double least_modulus() const;  ///< over all loops
  /// Returns the larger of the missing modulus and the missing logarithm of the torque per count;
  /// 0: none is missing.
  [[nodiscard]] double lack() const;
  /// Returns the same number at less cost, without `look_at_margins`.
  [[nodiscard]] double lack_alone();
  [[nodiscard]] Lack count_lack() const;  ///< the largest lack of all joints
  [[nodiscard]] bool stable() const;

  /// Returns, for each judged loop, the largest logarithm of an error from T to `window` T. The
  /// required fall up to that time is added to the logarithm.
  [[nodiscard]] Eigen::VectorXd log_errors(double T) const;
  /// Returns the last times up to `end_s` at which the errors of these loops exceed 1 %.
  [[nodiscard]] std::vector<double> settling_s(double end_s,
                                               const std::vector<std::size_t>& loops) const;

  // Append rows to the linear programme. Its variables are the step d of theta, the bound s of the
  // errors' logarithms and the missing margin v. Margin and count rows contain d alone. Error rows
  // contain all three variables.
  void add_margin_rows(std::size_t loop, std::vector<numerics::LinearProgramme::Row>& rows) const;
  void add_error_rows(std::size_t loop, double T, double largest,
                      std::vector<numerics::LinearProgramme::Row>& rows) const;
  void add_count_rows(std::vector<numerics::LinearProgramme::Row>& rows) const;

 private:
  void make_feedback(bool derivatives);
  void make_grids();
  [[nodiscard]] double lack_with(double least) const;
  /// Returns the largest torque per measured angle of each joint over the postures of the motion.
  /// Gains are moved by `by` along `variable`.
  [[nodiscard]] Eigen::VectorXd largest_gain(double by = 0, Eigen::Index variable = 0) const;
  [[nodiscard]] const linear::Feedback& feedback(std::size_t loop) const {
    return feedback_[problem_->same_everywhere ? 0 : loop];
  }
  [[nodiscard]] const std::vector<linear::FeedbackAt>& grid(std::size_t loop) const {
    return grids_[grids_.size() == 1 ? 0 : loop];
  }

  const GainProblem* problem_;
  Eigen::VectorXd theta_;
  std::vector<linear::Feedback> feedback_;
  std::vector<std::vector<linear::FeedbackAt>> grids_;
  std::vector<std::vector<double>> modulus_;
};

/// A linear programme about a point, with the positions of the point's rows.
struct Linearised {
  numerics::LinearProgramme programme;
  std::vector<std::size_t> first_margin_row;  ///< of each loop; then the end
};
Linearised programme_at(const GainProblem& problem, const GainPoint& point, double T,
                        const Eigen::VectorXd& log_errors, double radius);

}  // namespace tachless::design
