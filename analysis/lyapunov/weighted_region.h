#pragma once

#include <Eigen/Core>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "linear/effort.h"
#include "lyapunov/error_form.h"
#include "lyapunov/proved_form.h"
#include "scenario/scenario.h"

/// The certified region of the laws whose error equation is an `ErrorForm` (error_form.h). For
/// `flexible_position` and `flexible_motor` the weights of V are searched. `loria_ortega_adaptive`
/// has weights of its own, and its region holds at every corner of the box of the unknown
/// parameters. Time is continuous, there is no feed-forward lead, and the model is exact except for
/// these parameters. Searched weights are proved at every posture and instant for two revolute
/// joints and a constant reference or sums of sines. Every other region is evaluated at sampled
/// postures and instants, and is not proved.
namespace tachless::lyapunov {

struct WeightedRegion {
  FormRegion region;
  FormWeights weights;
  int forms = 0;        ///< number of postures and instants at which V falls
  bool proved = false;  ///< V falls at every posture and instant
  /// Largest displacement of one joint alone, its link and motor together, at rest [rad; m].
  Eigen::VectorXd e_at_rest;
  double V0 = 0;  ///< at the scenario's start [J]
  /// Largest part of V that belongs to the unknown parameters [J]. Nothing: the law has none.
  std::optional<double> of_parameters;
  std::vector<std::string> provisos;  ///< as in `StabilityCertificate`

  [[nodiscard]] bool holds_initial_state() const {
    return V0 + of_parameters.value_or(0) <= region.level;
  }
};

/// The loop of such a law: its forms, its start, and the weights or the choice of them.
class FormLoop {
 public:
  virtual ~FormLoop() = default;

  /// Returns the form of posture and instant number `k`, the first at the scenario's start.
  [[nodiscard]] virtual ErrorForm form(int k) const = 0;
  /// Returns the error coordinates y (error_form.h) at the start of the reference, with links and
  /// motors displaced by e [rad; m] and at rest.
  [[nodiscard]] virtual Eigen::VectorXd displaced(const Eigen::VectorXd& e) const = 0;
  /// Returns (y, edot) at the scenario's start.
  [[nodiscard]] virtual Eigen::VectorXd initial() const = 0;
  /// Returns typical sizes of P's diagonal.
  [[nodiscard]] virtual Eigen::VectorXd size() const = 0;
  /// Returns the law's own weights; nothing: they are searched.
  [[nodiscard]] virtual std::optional<FormWeights> weights() const { return {}; }
  /// Returns the loop with bounds over every posture and instant; nothing: none are known.
  [[nodiscard]] virtual std::optional<BoundedForm> bounded() const { return {}; }
  [[nodiscard]] virtual std::optional<double> of_parameters() const { return {}; }
  /// Returns the number of consecutive k that together have every corner of the parameters' box.
  [[nodiscard]] virtual int corners() const { return 1; }
};

/// Returns whether the certificate of the law is of this kind.
bool has_error_form(std::string_view law);

/// Returns the loop of the scenario's law. Returns nothing without a certificate, and writes the
/// reason to `why_not`. Precondition: `has_error_form`.
std::unique_ptr<FormLoop> form_loop(const scenario::Scenario& scenario, std::string& why_not);

/// Returns the region. Returns nothing if none was found, and writes the reason to `why_not`.
/// Precondition: `has_error_form`.
/// @throw base::Failure(bad_usage) if law, robot or reference cannot be made of the scenario
std::optional<WeightedRegion> weighted_region(const scenario::Scenario& scenario,
                                              std::string& why_not,
                                              const linear::OnProgress& tell = linear::no_progress);

}  // namespace tachless::lyapunov
