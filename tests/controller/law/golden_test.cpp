// The laws against tests/golden: closed loops on the paper's arm simulated by an independent
// program (closed-form model, its own code of the laws, Runge-Kutta). Each row is one tick of 1 ms:
// the laws are fed the recorded state and must give the recorded filter outputs and torques.

#include <gtest/gtest.h>

#include <numbers>
#include <vector>

#include "controller/law/loria_ortega_flexible.h"
#include "controller/law/loria_ortega_rigid.h"
#include "tests/controller/law/two_link.h"

namespace controller::law {
namespace {

using Row = std::vector<double>;

/// The columns' values row by row, t first; the line of names is skipped.
std::vector<Row> rows_of(const std::string& name) {
  const std::string path = std::string(TACHLESS_SOURCE_DIR) + "/tests/golden/" + name + ".csv";
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

robot::Vector two(const Row& row, int column) { return vector(row[column], row[column + 1]); }

/// Both joints: sin(10 pi t) / (10 pi).
robot::ReferencePoint papers_reference(double t) {
  const double w = 10 * std::numbers::pi, s = std::sin(w * t), c = std::cos(w * t);
  const auto both = [](double x) { return vector(x, x); };
  return {both(s / w), both(c), both(-w * s), both(-w * w * c), both(w * w * w * s)};
}

struct Case {
  const char* file;
  Discretisation filter;
  int delay;
  double lead_s;
  double torque_tolerance_Nm;
};

class GoldenRigid : public testing::TestWithParam<Case> {};

TEST_P(GoldenRigid, GivesTheRecordedTorqueForEachRecordedState) {
  const LoriaOrtegaRigid law(
      two_link_model(),
      {vector(40000, 2400), vector(1000, 60), vector(1000, 1000), vector(1000, 1000)},
      {1e-3, GetParam().filter, FilterStart::at_error, GetParam().lead_s});
  const std::vector<Row> rows = rows_of(GetParam().file);
  ASSERT_EQ(rows.size(), 2001U);
  robot::Vector before = vector(0, 0);
  LoriaOrtegaRigid::Memory memory;
  for (std::size_t k = 0; k < rows.size(); ++k) {
    const robot::PositionMeasurement measured{two(rows[k], 1)};
    const robot::ReferencePoint ref = papers_reference(1e-3 * static_cast<double>(k));
    const auto step = law.step(k == 0 ? law.start(measured, ref) : memory, measured, ref);
    memory = step.memory;
    const robot::Vector acting = GetParam().delay == 0 ? step.command.tau : before;
    before = step.command.tau;
    // Rounding of e, eps / 10, times b (nu) and Kp + Kd b (tau), piling up over 1 / (1 - phi).
    ASSERT_LE((step.state.nu[0] - two(rows[k], 5)).norm(), 5e-13) << k;
    ASSERT_LE((acting - two(rows[k], 7)).norm(), GetParam().torque_tolerance_Nm) << k;
  }
}

INSTANTIATE_TEST_SUITE_P(
    Cases, GoldenRigid,
    testing::Values(Case{"rigid_practical_foh_h1e-3_d0_offset", Discretisation::first_order_hold, 0,
                         0, 5e-10},
                    // The golden lead is exact; Taylor's remainder is lead^3 / 6 (10 pi)^4 = 5.5e-4
                    // rad/s^2 on joints of 12.8 and 2.4 kg m2 (row sums of M).
                    Case{"rigid_practical_foh_h1e-3_d1_lead_offset",
                         Discretisation::first_order_hold, 1, 1.5e-3, 8e-3}));

class GoldenFlexible : public testing::TestWithParam<Case> {};

TEST_P(GoldenFlexible, GivesTheRecordedTorqueForEachRecordedState) {
  const LoriaOrtegaFlexible law(
      {two_link_model(), vector(1e4, 1e4), vector(0.1, 0.1)},
      {vector(20000, 1500), vector(600, 30), vector(250, 250), vector(250, 250), vector(100, 100),
       vector(13, 20), vector(1000, 1000), vector(1000, 1000)},
      {1e-3, GetParam().filter});
  const std::vector<Row> rows = rows_of(GetParam().file);
  ASSERT_EQ(rows.size(), 2001U);
  robot::Vector before = vector(0, 0);
  LoriaOrtegaFlexible::Memory memory;
  for (std::size_t k = 0; k < rows.size(); ++k) {
    const robot::LinkStateMeasurement measured{two(rows[k], 1), two(rows[k], 3), two(rows[k], 5)};
    const robot::ReferencePoint ref = papers_reference(1e-3 * static_cast<double>(k));
    const auto step = law.step(k == 0 ? law.start(measured, ref) : memory, measured, ref);
    memory = step.memory;
    const robot::Vector acting = GetParam().delay == 0 ? step.command.tau : before;
    before = step.command.tau;
    // As for the rigid law.
    ASSERT_LE((step.state.nu[0] - two(rows[k], 9)).norm(), 5e-13) << k;
    ASSERT_LE((step.state.nu[1] - two(rows[k], 11)).norm(), 5e-13) << k;
    ASSERT_LE((acting - two(rows[k], 13)).norm(), GetParam().torque_tolerance_Nm) << k;
    const robot::Vector theta_ref = measured.theta - step.state.error[1];
    ASSERT_LE((theta_ref - two(rows[k], 15)).norm(), 1e-15) << k;
  }
}

INSTANTIATE_TEST_SUITE_P(Cases, GoldenFlexible,
                         testing::Values(Case{"flexible_practical_foh_h1e-3_d0_rest",
                                              Discretisation::first_order_hold, 0, 0, 3e-11},
                                         Case{"flexible_practical_tustin_h1e-3_d1_rest",
                                              Discretisation::tustin, 1, 0, 3e-11}));

}  // namespace
}  // namespace controller::law
