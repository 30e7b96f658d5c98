#pragma once

#include <Eigen/Core>
#include <vector>

#include "linear/frequencies.h"
#include "linear/linear_loop.h"
#include "linear/sampled_limit.h"
#include "numerics/linear_programme.h"

/// Constrained quantities of a loop at rest, and their derivatives by the gains of the law. The
/// quantities are the distance of L(exp(iwh)) from -1, and the errors after an initial error of
/// each joint alone. The derivatives are by the logarithms of the gains. The gains are numbered
/// kind by kind, and joint by joint within a kind.
namespace tachless::linear {

/// A law's feedback terms (D without the compensation), and their derivatives.
struct Feedback {
  LinearLaw law;
  std::vector<LinearLaw> by_kind;  ///< derivative by the gains of one kind, for all joints together
  /// True if each joint's gains act on its own torque and memory alone. In that case each gain is a
  /// variable of its own. Otherwise there is one variable for each kind.
  bool by_joint = true;

  [[nodiscard]] LinearLaw derivative(Eigen::Index variable) const;
};

/// Frequency response K of the feedback terms, torque = K y, with its derivatives by kind.
struct FeedbackAt {
  double w = 0;  ///< [rad/s]
  Eigen::MatrixXcd K;
  std::vector<Eigen::MatrixXcd> by_kind;
};
FeedbackAt at_frequency(const Feedback& feedback, double w, double period_s);
/// Returns the response at each of these frequencies.
std::vector<FeedbackAt> at_frequencies(const Feedback& feedback, const std::vector<double>& w,
                                       double period_s);

/// The frequencies at which a RestLoop keeps its response, ascending [rad/s].
std::vector<double> kept_frequencies(double period_s);

/// A plant at rest with its delay and with the law's compensation of gravity: the whole loop except
/// the feedback.
class RestLoop {
 public:
  RestLoop() = default;
  /// @param keeps_responses true: the responses at `kept_frequencies` are computed once; false: at
  /// each use
  RestLoop(const LinearPlant& plant, const LinearLaw& law, double period_s, int delay,
           bool keeps_responses = true);

  /// Returns the map of one period.
  [[nodiscard]] Eigen::MatrixXd closed(const LinearLaw& feedback) const;
  /// Returns initial states for `closed`, a column for each joint. In each column one joint and its
  /// rotor are displaced by 1 [rad; m]. The law's memory is the memory of a run that begins there.
  [[nodiscard]] Eigen::MatrixXd starts(const LinearLaw& feedback) const;

  /// Returns the least |1 + eigenvalue of L| at each of these frequencies. A value that is
  /// certainly above `enough` may be replaced by a smaller number above `enough`.
  [[nodiscard]] std::vector<double> modulus(const std::vector<FeedbackAt>& grid,
                                            double enough) const;
  /// Returns the least of `modulus` over the grid, or a smaller number above `enough`.
  [[nodiscard]] double least_modulus(const std::vector<FeedbackAt>& grid, double enough) const;
  /// Adds rows |1 + eigenvalue| + gradient' d >= `least` of the eigenvalues within `near` of
  /// `least`.
  void add_rows(const FeedbackAt& at, const Feedback& feedback, double least, double near,
                std::vector<numerics::LinearProgramme::Row>& rows) const;

  [[nodiscard]] Eigen::Index num_joints() const { return n_; }
  [[nodiscard]] double period_s() const { return period_s_; }

 private:
  /// 1 + L at a frequency, scaled by a diagonal matrix to be nearly normal.
  struct ReturnDifference {
    Eigen::MatrixXcd matrix;
    double bound;  ///< no eigenvalue is nearer to 0
  };
  [[nodiscard]] Eigen::MatrixXcd response(double w) const;
  [[nodiscard]] Eigen::MatrixXcd solved_response(double w) const;
  [[nodiscard]] ReturnDifference return_difference(const FeedbackAt& at) const;

  Eigen::Index n_ = 0;
  double period_s_ = 0;
  std::vector<double> w_;               ///< frequencies of the kept responses
  std::vector<Eigen::MatrixXcd> at_w_;  ///< the responses there
  Eigen::MatrixXd A_, B_, C_;           ///< plant from torque to measurement
  Eigen::MatrixXd displaced_;           ///< states of A_
  /// The plant in the coordinates of its complex Schur form. `FrequencyResponse` is faster, but
  /// rounds otherwise, and the search for gains is not continuous in rounding: of four arms, the
  /// gains that were not taken settled by up to 30 % sooner or later.
  Eigen::MatrixXcd T_, input_, output_;
};

/// An error is settled if it stays below this share of the first error.
inline constexpr double settled = 0.01;

/// The errors of all joints after each joint alone is displaced, a row for each instant.
struct Errors {
  std::vector<double> time_s;
  Eigen::MatrixXd error;  ///< column k n + i: error of joint i after joint k is displaced

  /// Returns the last instant at which an error is not settled, after each joint is displaced [s];
  /// 0: all are settled at each instant.
  [[nodiscard]] Eigen::VectorXd last_unsettled_s() const;
};
/// Returns the errors at most `most_instants` instants from `begin_s` to `end_s`: every 2^k-th
/// tick.
/// @param map map of one period; the errors of the n joints are the first n states
/// @param starts initial states of `map`, a column for each displaced joint
Errors errors(const Eigen::MatrixXd& map, const Eigen::MatrixXd& starts, double period_s,
              double begin_s, double end_s, int most_instants);
Errors errors(const RestLoop& loop, const LinearLaw& feedback, double begin_s, double end_s,
              int most_instants);

}  // namespace tachless::linear
