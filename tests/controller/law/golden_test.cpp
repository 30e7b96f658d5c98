// Tests of the laws against tests/golden. These closed loops on the paper's arm were simulated by
// an independent program: closed-form model, its own code of the laws, Runge-Kutta. With a row's
// state and filter outputs, a law must return the row's torque. (tests/study tests the closed loops
// themselves.)

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <stdexcept>
#include <vector>

#include "controller/law/loria_ortega_flexible.h"
#include "controller/law/loria_ortega_rigid.h"
#include "tests/controller/law/two_link.h"

namespace tachless::controller::law::golden_test {
namespace {

using Row = std::vector<double>;

/// Returns the columns' values row by row, t first; skips the line of names.
std::vector<Row> rows_of(const std::string& name) {
  const std::string path = TACHLESS_SOURCE_DIR "/tests/golden/" + name + ".csv";
  std::ifstream file(path);
  std::string line;
  if (!std::getline(file, line)) {
    throw std::runtime_error("cannot read " + path);
  }
  std::vector<Row> rows;
  while (std::getline(file, line)) {
    std::stringstream cells(line);
    rows.emplace_back();
    for (std::string cell; std::getline(cells, cell, ',');) {
      rows.back().push_back(std::stod(cell));
    }
  }
  return rows;
}

Vector two(const Row& row, int column) { return vector(row[column], row[column + 1]); }

/// The reference of both joints: sin(10 pi t) / (10 pi).
messages::ReferencePoint papers_reference(double t) {
  const double w = 10 * std::numbers::pi, s = std::sin(w * t), c = std::cos(w * t);
  const auto both = [](double x) { return vector(x, x); };
  return {both(s / w), both(c), both(-w * s), both(-w * w * c), both(w * w * w * s)};
}

/// Returns the filter's coefficients by the table of docs/laws/loria_ortega_rigid.md. They are
/// computed apart from the law, so that an error in the law does not cancel here.
FilterCoefficients tabulated(Discretisation kind, double a, double b, double h) {
  const long double ah = static_cast<long double>(a) * h;
  const auto pair = [](long double phi, long double beta) {
    return FilterCoefficients{static_cast<double>(phi), static_cast<double>(beta)};
  };
  switch (kind) {
    case Discretisation::first_order_hold:
      return pair(std::exp(-ah), b * (1 - std::exp(-ah)) / ah);
    case Discretisation::tustin:
      return pair((2 - ah) / (2 + ah), 2 * b / (2 + ah));
    case Discretisation::backward_euler:
      return pair(1 / (1 + ah), b / (1 + ah));
    case Discretisation::zero_order_hold:
      return pair(std::exp(-ah), b);
  }
  throw std::logic_error("no such discretisation");
}

/// Returns a filter memory from which a step at error e gives the output nu. Both coefficients
/// matter: the previous error differs by some 1e-6 rad, which is 1e-3 rad/s of nu.
Filter::Memory memory_before(const Vector& nu, const Vector& e, const FilterCoefficients& filter) {
  const Vector e_previous = e + vector(1e-6, -2e-6);
  return {(nu - filter.beta * (e - e_previous)) / filter.phi, e_previous};
}

struct Case {
  const char* file;
  Discretisation filter;
  double period_s;
  bool papers_gains;
  double lead_s;
  double torque_tolerance_Nm;
};

class GoldenRigid : public testing::TestWithParam<Case> {};

TEST_P(GoldenRigid, GivesTheRecordedTorqueForEachRecordedState) {
  const Case& c = GetParam();
  const LoriaOrtegaRigid law(two_link_model(),
                             c.papers_gains
                                 ? LoriaOrtegaRigid::Gains{vector(5000, 6000), vector(7000, 8800),
                                                           vector(1000, 1000), vector(1000, 1000)}
                                 : LoriaOrtegaRigid::Gains{vector(40000, 2400), vector(1000, 60),
                                                           vector(1000, 1000), vector(1000, 1000)},
                             {c.period_s, c.filter, FilterStart::at_error, c.lead_s});
  const FilterCoefficients filter = tabulated(c.filter, 1000, 1000, c.period_s);
  const std::vector<Row> rows = rows_of(c.file);
  ASSERT_GT(rows.size(), 50U);
  for (const Row& row : rows) {
    const messages::PositionMeasurement measured{two(row, 1)};
    const messages::ReferencePoint ref = papers_reference(row[0]);
    const auto step =
        law.step(memory_before(two(row, 5), measured.q - ref.q_ref, filter), measured, ref);
    ASSERT_LE((step.command.tau - two(row, 7)).norm(), c.torque_tolerance_Nm) << row[0];
  }
}

// Bounds on rounding of sums: ten times the measured values. With lead, the golden reference ahead
// is exact. Taylor's remainder of vdot_ref is (h / 2)^3 / 6 (10 pi)^4 = 2.1e-5 rad/s^2, on joints
// of 11.3 and 1.9 kg m2 (row sums of M).
INSTANTIATE_TEST_SUITE_P(
    Cases, GoldenRigid,
    testing::Values(Case{"rigid_paper_foh_h5e-5_d0_rest", Discretisation::first_order_hold, 5e-5,
                         true, 0, 1e-11},
                    Case{"rigid_paper_foh_h5e-5_d0_offset", Discretisation::first_order_hold, 5e-5,
                         true, 0, 1e-11},
                    Case{"rigid_paper_foh_h2.5e-5_d0_rest", Discretisation::first_order_hold,
                         2.5e-5, true, 0, 1e-11},
                    Case{"rigid_paper_tustin_h5e-5_d0_rest", Discretisation::tustin, 5e-5, true, 0,
                         1e-11},
                    Case{"rigid_paper_backward_euler_h5e-5_d0_rest", Discretisation::backward_euler,
                         5e-5, true, 0, 1e-11},
                    Case{"rigid_paper_zoh_h5e-5_d0_rest", Discretisation::zero_order_hold, 5e-5,
                         true, 0, 1e-11},
                    Case{"rigid_practical_foh_h1e-3_d0_offset", Discretisation::first_order_hold,
                         1e-3, false, 0, 5e-11},
                    Case{"rigid_practical_foh_h1e-3_d0_lead_offset",
                         Discretisation::first_order_hold, 1e-3, false, 5e-4, 3e-4}));

class GoldenFlexible : public testing::TestWithParam<Case> {};

TEST_P(GoldenFlexible, GivesTheRecordedTorqueForEachRecordedState) {
  const Case& c = GetParam();
  const double a1 = c.papers_gains ? 1000 : 250;
  const auto both = [](double x) { return vector(x, x); };
  const LoriaOrtegaFlexible law(
      {two_link_model(), both(1e4), both(0.1)},
      c.papers_gains
          ? LoriaOrtegaFlexible::Gains{both(1e4), vector(7000, 8800), both(1000), both(1000),
                                       both(1e4), vector(7000, 8800), both(1000), both(1000)}
          : LoriaOrtegaFlexible::Gains{vector(20000, 1500), vector(600, 30), both(250), both(250),
                                       both(100), vector(13, 20), both(1000), both(1000)},
      {c.period_s, c.filter});
  const FilterCoefficients link = tabulated(c.filter, a1, a1, c.period_s);
  const FilterCoefficients motor = tabulated(c.filter, 1000, 1000, c.period_s);
  const std::vector<Row> rows = rows_of(c.file);
  ASSERT_GT(rows.size(), 50U);
  for (const Row& row : rows) {
    const messages::LinkStateMeasurement measured{two(row, 1), two(row, 3), two(row, 5)};
    const messages::ReferencePoint ref = papers_reference(row[0]);
    const Vector theta_ref = two(row, 15);
    const auto step = law.step({memory_before(two(row, 9), measured.q - ref.q_ref, link),
                                memory_before(two(row, 11), measured.theta - theta_ref, motor)},
                               measured, ref);
    // One eps in theta_ref, a sum of terms of 1 rad, is kd2 beta = 9e6 of it in torque.
    ASSERT_LE((measured.theta - step.signals.value[2] - theta_ref).norm(), 1e-15) << row[0];
    ASSERT_LE((step.command.tau - two(row, 13)).norm(), c.torque_tolerance_Nm) << row[0];
  }
}

INSTANTIATE_TEST_SUITE_P(
    Cases, GoldenFlexible,
    testing::Values(Case{"flexible_practical_foh_h1e-3_d0_rest", Discretisation::first_order_hold,
                         1e-3, false, 0, 3e-12},
                    Case{"flexible_paper_foh_h1e-5_d0_rest", Discretisation::first_order_hold, 1e-5,
                         true, 0, 1e-8},
                    Case{"flexible_paper_foh_h1e-5_d0_on_reference",
                         Discretisation::first_order_hold, 1e-5, true, 0, 1e-8}));

}  // namespace
}  // namespace tachless::controller::law::golden_test
