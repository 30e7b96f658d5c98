#include "identify/load.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <numbers>
#include <vector>

#include "base/json_text.h"
#include "numerics/decompositions.h"
#include "robot/model.h"

namespace tachless::identify {
namespace {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::Vector3d;
using Eigen::VectorXd;

/// Rows and columns of the components, and their places in an `Inertial`.
struct Component {
  Index row, column, inertial;
};
constexpr std::array<Component, 6> components = {
    {{0, 0, 4}, {0, 1, 7}, {0, 2, 8}, {1, 1, 5}, {1, 2, 9}, {2, 2, 6}}};

Matrix3d matrix(const Load::Six& inertia) {
  Matrix3d I;
  I << inertia[0], inertia[1], inertia[2], inertia[1], inertia[3], inertia[4], inertia[2],
      inertia[4], inertia[5];
  return I;
}

/// An inertia as KUKA's controllers take it: principal moments, and the angles of the principal
/// axes in degrees about z, the new y and the new x.
struct Principal {
  Vector3d moments, angles;

  explicit Principal(const Load::Six& inertia) {
    const auto [values, vectors] = numerics::symmetric_eigen(matrix(inertia));
    Matrix3d R = vectors;
    if (R.determinant() < 0) R.col(2) *= -1;
    moments = values;
    angles = 180 / std::numbers::pi *
             Vector3d(std::atan2(R(1, 0), R(0, 0)), std::asin(std::clamp(-R(2, 0), -1.0, 1.0)),
                      std::atan2(R(2, 1), R(2, 2)));
  }
};

/// Joins numbers as controllers take them.
std::string list(const auto& numbers) { return fmt::format("{:.5g}", fmt::join(numbers, ", ")); }

Matrix3d written(const Load& load) { return matrix(load.written_inertia()); }

std::string urdf_link(const Load& load) {
  const Load::Six I = load.written_inertia();
  return fmt::format(
      "<link name=\"payload\"><inertial><origin xyz=\"{:.6g}\"/><mass value=\"{:.6g}\"/>"
      "<inertia ixx=\"{:.6g}\" ixy=\"{:.6g}\" ixz=\"{:.6g}\" iyy=\"{:.6g}\" iyz=\"{:.6g}\" "
      "izz=\"{:.6g}\"/></inertial></link><joint name=\"payload\" type=\"fixed\"><parent "
      "link=\"{}\"/><child link=\"payload\"/></joint>",
      fmt::join(load.centre, " "), load.mass, I[0], I[1], I[2], I[3], I[4], I[5], load.frame);
}

}  // namespace

Load load_of(const Precision& precision, const VectorXd& values, const Parameters& parameters,
             const std::string& frame) {
  const Index first = parameters.first(Kind::load), size = values.size();
  const Inertial x = values.segment<10>(first);
  const double m = std::max(x[0], 1e-9);
  Load load;
  load.frame = frame;
  load.mass = x[0];
  load.mass_half_width = precision.half_width[first];
  // The centre is a quotient, and the inertia about it a sum, with the mass.
  const bool mass_shown = load.mass > load.mass_half_width;
  for (Index i = 0; i < 3; ++i) {
    const bool shown = mass_shown && std::isfinite(precision.half_width[first + 1 + i]);
    load.centre[i] = shown ? x[1 + i] / m : 0;
    VectorXd change = VectorXd::Zero(size);
    change[first] = -load.centre[i] / m;
    change[first + 1 + i] = 1 / m;
    load.centre_half_width[i] =
        shown ? precision.half_width_of(change) : std::numeric_limits<double>::infinity();
  }
  const Vector3d& c = load.centre;
  for (Index i = 0; i < 6; ++i) {
    const auto [row, column, at] = components[static_cast<std::size_t>(i)];
    const double square = row == column ? c.squaredNorm() : 0;
    load.inertia[i] = x[at] - m * (square - c[row] * c[column]);
    VectorXd change = VectorXd::Zero(size);
    change[first + at] = 1;
    // I_C = I - (f'f 1 - f f') / m with the first moments f = m c.
    change[first] = square - c[row] * c[column];
    for (Index k = 0; k < 3; ++k) {
      const double own = (k == row ? c[column] : 0) + (k == column ? c[row] : 0);
      change[first + 1 + k] = own - (row == column ? 2 * c[k] : 0);
    }
    load.inertia_half_width[i] = mass_shown && std::isfinite(precision.half_width[first + at])
                                     ? precision.half_width_of(change)
                                     : std::numeric_limits<double>::infinity();
  }
  const Matrix3d I = matrix(load.inertia);
  load.inertia_shown = load.inertia_half_width.maxCoeff() < I.trace() / 9 &&
                       robot::why_not_physical({load.mass, load.centre, I}).empty();
  return load;
}

std::string override_of(const Load& load) {
  return fmt::format(
      "plant.payload={{mass_kg: {:.6g}, link: {}, center_of_mass_m: [{:.6g}], inertia_kgm2: "
      "[{:.6g}]}}",
      load.mass, load.frame, fmt::join(load.centre, ", "), fmt::join(load.written_inertia(), ", "));
}

std::string text(const Load& load) {
  std::string text = fmt::format("  payload on {}: {:.5g} +- {:.2g} kg\n", load.frame, load.mass,
                                 load.mass_half_width);
  for (Index i = 0; i < 3; ++i) {
    const bool shown = std::isfinite(load.centre_half_width[i]);
    text += fmt::format(
        "    centre {} {}\n", "xyz"[i],
        shown ? fmt::format("{:>10.4g} +- {:.2g} m", load.centre[i], load.centre_half_width[i])
              : "is not shown by this motion");
  }
  text += load.inertia_shown
              ? fmt::format(
                    "    inertia about the centre, xx, xy, xz, yy, yz, zz: [{:.4g}] +- "
                    "[{:.2g}] kg m2\n",
                    fmt::join(load.inertia, ", "), fmt::join(load.inertia_half_width, ", "))
              : "    inertia is not shown by this motion; a point mass is written\n";
  const Matrix3d I = written(load);
  const Principal principal(load.written_inertia());
  text += fmt::format("    Franka setLoad: {:.5g}, {{{}}}, {{{}}}\n", load.mass, list(load.centre),
                      list(I.reshaped()));
  text += fmt::format(
      "    UR set_target_payload: {:.5g}, [{}], [{:.5g}, {:.5g}, {:.5g}, {:.5g}, "
      "{:.5g}, {:.5g}]\n",
      load.mass, list(load.centre), I(0, 0), I(1, 1), I(2, 2), I(0, 1), I(0, 2), I(1, 2));
  const Vector3d mm = 1000 * load.centre;
  text += fmt::format(
      "    KUKA LOAD: {{M {:.5g}, CM {{X {:.4g}, Y {:.4g}, Z {:.4g}, A {:.4g}, B {:.4g}, C "
      "{:.4g}}}, J {{X {:.4g}, Y {:.4g}, Z {:.4g}}}}}\n",
      load.mass, mm[0], mm[1], mm[2], principal.angles[0], principal.angles[1], principal.angles[2],
      principal.moments[0], principal.moments[1], principal.moments[2]);
  return text + "    URDF: " + urdf_link(load) + "\n";
}

void to_json(nlohmann::ordered_json& json, const Load& load) {
  const Matrix3d I = written(load);
  const Principal principal(load.written_inertia());
  json = {{"link", load.frame},
          {"mass_kg", load.mass},
          {"mass_half_width", load.mass_half_width},
          {"center_of_mass_m", base::json_list(load.centre)},
          {"center_of_mass_half_width", base::json_list(load.centre_half_width)},
          {"inertia_kgm2", base::json_list(load.inertia)},
          {"inertia_half_width", base::json_list(load.inertia_half_width)},
          {"inertia_shown", load.inertia_shown},
          {"urdf", urdf_link(load)},
          {"franka",
           {{"mass", load.mass},
            {"F_x_Cload", base::json_list(load.centre)},
            {"load_inertia", base::json_list(I.reshaped())}}},
          {"ur",
           {{"m", load.mass},
            {"cog", base::json_list(load.centre)},
            {"inertia", {I(0, 0), I(1, 1), I(2, 2), I(0, 1), I(0, 2), I(1, 2)}}}},
          {"kuka",
           {{"M", load.mass},
            {"CM_mm", base::json_list((1000 * load.centre).eval())},
            {"CM_ABC_deg", base::json_list(principal.angles)},
            {"J", base::json_list(principal.moments)}}}};
}

}  // namespace tachless::identify
