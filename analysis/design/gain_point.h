#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "design/gain_search.h"

/// The problem of a search for gains at one point, and the linear programme about that.
namespace tachless::design {

using linear::FeedbackAt;
using numerics::LinearProgramme;

constexpr double settled = 0.01;
constexpr double price_of_margin = 60;
constexpr double margin_kept = 0.003;  // of it for what is between the frequencies
// How long the errors are looked at, as part of T.
constexpr double window = 3;
constexpr double near_margin = 0.3;  // rows of eigenvalues within it

class GainPoint {
 public:
  GainPoint(const GainProblem& problem, const Eigen::VectorXd& theta);
  /// Before moduli and programmes; that much above the margin are bounds from below.
  void look_at_margins(double above = near_margin);
  void differentiate();  ///< before a programme is asked for

  [[nodiscard]] const Eigen::VectorXd& theta() const { return theta_; }
  [[nodiscard]] Eigen::Index num_joints() const { return feedback_[0].law.D.rows(); }
  /// Over a loop's share of the margin.
  [[nodiscard]] double least_modulus(std::size_t loop) const;
  [[nodiscard]] double least_modulus() const;  ///< of all loops
  /// What margins and counts lack; at most 0: nothing.
  [[nodiscard]] double lack() const;
  [[nodiscard]] bool stable() const;

  /// Log of the largest error in the window of T, of each loop whose errors are looked at.
  [[nodiscard]] Eigen::VectorXd log_errors(double T) const;
  /// When the errors are last above 1 %, up to `end_s`, at these loops.
  [[nodiscard]] std::vector<double> settling_s(double end_s,
                                               const std::vector<std::size_t>& loops) const;

  // Rows in (d, s, v) with v = 0 for rows without it.
  void add_margin_rows(std::size_t loop, std::vector<numerics::LinearProgramme::Row>& rows) const;
  void add_error_rows(std::size_t loop, double T, double largest,
                      std::vector<numerics::LinearProgramme::Row>& rows) const;
  void add_count_rows(std::vector<numerics::LinearProgramme::Row>& rows) const;

 private:
  void make_feedback(bool derivatives);
  void make_grids();
  /// Torque per measured angle, the largest at the postures of the motion; of gains moved that far.
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

/// A linear programme about a point, and where its rows are.
struct Linearised {
  numerics::LinearProgramme programme;
  std::vector<std::size_t> first_margin_row;  ///< of each loop, and the end
};
Linearised programme_at(const GainProblem& problem, const GainPoint& point, double T,
                        const Eigen::VectorXd& log_errors, double radius);

}  // namespace tachless::design
