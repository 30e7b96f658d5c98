#include "robot/mjcf_inertia.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <numbers>

namespace tachless::robot {
namespace {

using std::numbers::pi;

/// Returns how many sizes a primitive has; 0 for another type.
std::size_t num_sizes(std::string_view type) {
  if (type == "sphere") return 1;
  if (type == "capsule" || type == "cylinder") return 2;
  return type == "ellipsoid" || type == "box" ? 3 : 0;
}

double volume(const MjcfShape& shape) {
  const Eigen::Vector3d& s = shape.size;
  if (shape.type == "sphere") return 4.0 / 3 * pi * s[0] * s[0] * s[0];
  if (shape.type == "capsule") return pi * s[0] * s[0] * (2 * s[1] + 4.0 / 3 * s[0]);
  if (shape.type == "cylinder") return pi * s[0] * s[0] * 2 * s[1];
  if (shape.type == "ellipsoid") return 4.0 / 3 * pi * s.prod();
  return 8 * s.prod();
}

/// Returns the principal moments of a primitive of mass `m` about its centre.
Eigen::Vector3d moments(const MjcfShape& shape, double m) {
  const Eigen::Vector3d &s = shape.size, squares = s.cwiseAbs2();
  if (shape.type == "sphere") return Eigen::Vector3d::Constant(0.4 * m * squares[0]);
  if (shape.type == "ellipsoid" || shape.type == "box") {
    const double divisor = shape.type == "box" ? 3 : 5;
    return m / divisor *
           Eigen::Vector3d(squares[1] + squares[2], squares[0] + squares[2],
                           squares[0] + squares[1]);
  }
  const double r = s[0], h = 2 * s[1];
  // A capsule's two halves of a sphere have their share of the mass by volume.
  const double ends = shape.type == "capsule" ? m * 4 * r / (4 * r + 3 * h) : 0;
  const double middle = m - ends;
  const double across =
      middle * (3 * r * r + h * h) / 12 + ends * (0.4 * r * r + h * (3 * r + 2 * h) / 8);
  return {across, across, middle * r * r / 2 + 0.4 * ends * r * r};
}

Eigen::Matrix3d turned(const Eigen::Vector3d& principal, const Eigen::Quaterniond& q) {
  return rotated(principal.asDiagonal(), q.toRotationMatrix());
}

}  // namespace

MassProperties mass_of_inertial(const MjcfDocument& document, const MjcfAttributes& inertial) {
  const MjcfPose pose = document.pose(inertial);
  for (const char* name : {"pos", "mass"}) {
    if (!inertial.has(name)) inertial.refuse(fmt::format("it has no {}; add one", name));
  }
  MassProperties mass{inertial.number("mass", 0), pose.p, Eigen::Matrix3d::Zero()};
  const auto full = inertial.numbers("fullinertia", 6, 6);
  if (full.empty()) {
    mass.I_Bcm = turned(inertial.vector("diaginertia", Eigen::Vector3d::Zero()), pose.q);
    return mass;
  }
  if (inertial.has("diaginertia") || !pose.q.coeffs().isApprox(Eigen::Vector4d::UnitW(), 0)) {
    inertial.refuse("fullinertia beside diaginertia or an orientation; remove one");
  }
  mass.I_Bcm << full[0], full[3], full[4], full[3], full[1], full[5], full[4], full[5], full[2];
  return mass;
}

MjcfShape shape_of(const MjcfDocument& document, const MjcfAttributes& geom) {
  MjcfShape shape{geom.text("type", "sphere"), document.pose(geom), Eigen::Vector3d::Zero()};
  const std::size_t needed = num_sizes(shape.type);
  if (needed == 0 || geom.has("mesh")) return shape;
  const auto ends = geom.numbers("fromto", 6, 6);
  if (!ends.empty() && shape.type == "sphere") geom.refuse("fromto of a sphere; give pos and size");
  std::vector<double> size = geom.numbers("size", ends.empty() ? needed : 1, 3);
  if (size.empty()) geom.refuse(fmt::format("a {} without size; give size=\"...\"", shape.type));
  size.resize(3);
  if (!ends.empty()) {
    const Eigen::Vector3d a(ends[0], ends[1], ends[2]), b(ends[3], ends[4], ends[5]);
    if ((a - b).norm() < 1e-10) geom.refuse("fromto: two equal points; give two different ones");
    shape.pose = {from_z_to(a - b), 0.5 * (a + b)};
    const double half = 0.5 * (a - b).norm();
    size = needed == 2 ? std::vector{size[0], half, 0.0} : std::vector{size[0], size[0], half};
  }
  for (std::size_t i = 0; i < needed; ++i) {
    if (size[i] <= 0) geom.refuse(fmt::format("size {}; allowed: above 0", size[i]));
    shape.size[static_cast<Eigen::Index>(i)] = size[i];
  }
  return shape;
}

bool has_mass(const MjcfDocument& document, const MjcfAttributes& geom) {
  const std::string type = geom.text("type", "sphere");
  if (type == "plane" || type == "hfield") return false;
  const auto groups = document.compiler().numbers("inertiagrouprange", 2, 2);
  const double group = geom.number("group", 0);
  if (!groups.empty() && (group < groups[0] || group > groups[1])) return false;
  return geom.has("mass") ? geom.number("mass", 0) != 0 : geom.number("density", 1000) != 0;
}

MassProperties mass_of_geom(const MjcfDocument& document, const MjcfAttributes& geom) {
  const MjcfShape shape = shape_of(document, geom);
  if (geom.has("mesh") || num_sizes(shape.type) == 0) {
    geom.refuse(fmt::format(
        "its body has no <inertial>, and the mass of a {} is not read; give the body an <inertial> "
        "(MuJoCo saves it, compiler saveinertial=\"true\"), or the geom mass=\"0\"",
        geom.has("mesh") ? "mesh" : shape.type));
  }
  if (geom.flag("shellinertia", false)) {
    geom.refuse("shellinertia is not read; give the body an <inertial>");
  }
  const double mass =
      geom.has("mass") ? geom.number("mass", 0) : geom.number("density", 1000) * volume(shape);
  if (mass < 0) geom.refuse(fmt::format("mass {:g} kg; allowed: from 0 on", mass));
  return {mass, shape.pose.p, turned(moments(shape, mass), shape.pose.q)};
}

MassProperties corrected(const MjcfDocument& document, MassProperties body) {
  const MjcfAttributes& compiler = document.compiler();
  body.mass = std::max(body.mass, compiler.number("boundmass", 0));
  const double least = compiler.number("boundinertia", 0);
  const bool balances = compiler.flag("balanceinertia", false);
  if (least <= 0 && !balances) return body;
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(body.I_Bcm);
  Eigen::Vector3d I = solver.eigenvalues().cwiseMax(least);
  if (balances && I[0] + I[1] < I[2]) I.setConstant(I.mean());
  if (I != solver.eigenvalues()) body.I_Bcm = rotated(I.asDiagonal(), solver.eigenvectors());
  return body;
}

}  // namespace tachless::robot
