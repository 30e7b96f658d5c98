#include "robot/mass_properties.h"

#include <Eigen/Eigenvalues>
#include <cmath>
#include <locale>
#include <sstream>

namespace tachless::robot {

MassProperties combine(const MassProperties& a, const MassProperties& b) {
  // Exactly: no rounding where nothing is added.
  if (a.mass == 0 && a.I_cm.isZero(0)) return b;
  if (b.mass == 0 && b.I_cm.isZero(0)) return a;
  MassProperties both;
  both.mass = a.mass + b.mass;
  if (both.mass == 0) return {0, a.p_cm, a.I_cm + b.I_cm};
  both.p_cm = (a.mass * a.p_cm + b.mass * b.p_cm) / both.mass;
  const Eigen::Vector3d d = b.p_cm - a.p_cm;
  const double reduced = a.mass * b.mass / both.mass;
  both.I_cm = a.I_cm + b.I_cm +
              reduced * (d.squaredNorm() * Eigen::Matrix3d::Identity() - d * d.transpose());
  return both;
}

Eigen::Matrix3d rotated(const Eigen::Matrix3d& I, const Eigen::Matrix3d& R) {
  if (R.isIdentity(0)) return I;
  const Eigen::Matrix3d product = R * I * R.transpose();
  return 0.5 * (product + product.transpose());
}

std::string why_not_physical(const MassProperties& body) {
  std::ostringstream out;
  out.imbue(std::locale::classic());
  if (!std::isfinite(body.mass) || body.mass < 0) {
    out << "mass " << body.mass << " kg is not a mass; give a finite value of 0 or more";
  } else if (!body.p_cm.allFinite() || !body.I_cm.allFinite()) {
    out << "inertial origin or inertia is not finite; give finite numbers";
  } else if (body.mass == 0 && !body.I_cm.isZero(0)) {
    out << "inertia without mass; give it a mass, or inertia 0 as well";
  } else {
    const Eigen::Vector3d I =
        Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(body.I_cm, Eigen::EigenvaluesOnly)
            .eigenvalues();
    constexpr double gyration_m = 1e-6;
    const double rounding = 1e-6 * I.cwiseAbs().maxCoeff() + body.mass * gyration_m * gyration_m;
    if (I[0] < -rounding) {
      out << "inertia has principal moment " << I[0]
          << " kg m2; a body's are 0 or more: correct ixx ... izz";
    } else if (I[0] + I[1] < I[2] - rounding) {
      out << "principal moments of inertia " << I[0] << ", " << I[1] << ", " << I[2]
          << " kg m2 violate the triangle inequality (" << I[2] << " > " << I[0] << " + " << I[1]
          << "): no body has them; correct ixx ... izz";
    }
  }
  return out.str();
}

}  // namespace tachless::robot
