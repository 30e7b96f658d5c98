// Measures how often the 95 % intervals of `identify` hold the true values of random arms, and how
// often a right model is called wrong. docs/identification.md has the numbers.
//
//   identify_coverage KIND ARMS [FIRST]   KIND: exact, aligned, noise, late (tables), log,
//   noisy_log

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <random>
#include <string>
#include <string_view>
#include <vector>

#include "tests/analysis/identify/hidden_arm.h"
#include "tests/analysis/identify/table_of_motion.h"

namespace {

using namespace tachless;
using namespace tachless::identify;

/// The kinds of data. A table's torques are those of a motion at its instants without a loop, the
/// means around the instants of a run, those with 1 % of noise, or the commands, which act a tick
/// later and are held over it. A noisy log's encoders have up to 2e-4 rad of noise.
enum class Data { exact, aligned, noise, late, log, noisy_log };

/// Returns the table of a motion with the torques that it takes exactly, at 200 Hz. Only positions
/// are rounded, to the encoders' counts.
Recording exact_table(const scenario::Scenario& believed, const scenario::Scenario& plant,
                      unsigned seed) {
  robot::Model arm = scenario::with_payload(plant, *plant.model);
  arm.rotor_inertia = plant.robot.rigid_rotor_inertia_kgm2;
  const plant::DriveSpec& drive = plant.plant.drive;
  const auto friction = [&](Eigen::Index joint, double v, double /*load*/) {
    return drive.viscous_friction_Nms_per_rad[joint] * v +
           (v > 0 ? 1 : -1) * drive.coulomb_friction_Nm[joint];
  };
  Recording table = table_of_motion(believed, arm, 15, 0.01 * (seed % 37), friction);
  const Vector count = scenario::encoder_count(believed, *believed.model);
  for (Eigen::Index j = 0; j < count.size(); ++j) {
    table.q.col(j) = count[j] * (table.q.col(j) / count[j]).array().round().matrix();
  }
  return table;
}

/// Returns the recording of a run as a table.
Recording table_of(const Recording& run, Data data, std::mt19937& random) {
  Recording table = run;
  table.controlled = false;
  const Eigen::Index rows = run.num_ticks();
  if (data == Data::late) {
    // The torque over a tick was commanded a tick before.
    table.tau.topRows(rows - 1) = run.tau.bottomRows(rows - 1);
    return table;
  }
  table.tau.bottomRows(rows - 1) = 0.5 * (run.tau.topRows(rows - 1) + run.tau.bottomRows(rows - 1));
  if (data != Data::noise) return table;
  std::normal_distribution<double> normal;
  const Eigen::RowVectorXd size = 0.01 * table.tau.cwiseAbs().colwise().maxCoeff();
  for (Eigen::Index k = 0; k < rows; ++k) {
    for (Eigen::Index j = 0; j < size.size(); ++j) table.tau(k, j) += size[j] * normal(random);
  }
  return table;
}

struct Tally {
  int held = 0, of = 0;
  std::vector<double> errors;
};

struct Campaign {
  Data data;
  std::map<Kind, Tally> kinds;
  int arms = 0, called_wrong = 0;

  void add(unsigned seed) {
    std::mt19937 random(seed + 77000);
    const bool is_log = data == Data::log || data == Data::noisy_log;
    const char* const robot = seed % 3 != 2 ? "practical_rigid" : "iiwa_point_to_point";
    const std::string bits = std::to_string((is_log ? 14 : 16) + 2 * (seed % 4 % 3));
    scenario::Scenario believed = identify::scenario(robot, bits, 15);
    if (data == Data::noisy_log) {
      believed.plant.encoder.noise_std_rad = 5e-5 * static_cast<double>(seed % 5);
    }
    const Parameters parameters(believed, all);
    const Eigen::VectorXd truth = draw_truth(believed, parameters, random);
    const scenario::Scenario plant = hidden(believed, truth);
    Recording run =
        data == Data::exact ? exact_table(believed, plant, seed) : record(believed, plant);
    std::vector<Kind> unknown = all;
    if (!is_log) {
      if (data != Data::exact) run = table_of(run, data, random);
      unknown.push_back(Kind::delay);
    }
    const Identified found = identify::identify({run}, unknown, {}, ignore);
    ++arms;
    for (const Identified::Check& each : found.checks) called_wrong += each.misfit.found;
    for (Eigen::Index i = 0; i < truth.size(); ++i) {
      const Identified::Parameter& each = found.parameters[static_cast<std::size_t>(i)];
      const double error = std::abs(each.value - truth[i]);
      Tally& tally = kinds[each.entry.kind];
      tally.held += error <= each.half_width ? 1 : 0;
      ++tally.of;
      tally.errors.push_back(error / truth[i]);
      if (error > each.half_width && std::getenv("MISSES") != nullptr) {
        fmt::print("  arm {} {} {} bits: {} off by {:.3g} of it, {:.2g} half widths\n", seed, robot,
                   bits, each.entry.name, error / truth[i], error / each.half_width);
      }
    }
  }

  void print() {
    int held = 0, of = 0;
    fmt::print("{} arms:", arms);
    for (auto& [kind, tally] : kinds) {
      std::ranges::nth_element(tally.errors, tally.errors.begin() + std::ssize(tally.errors) / 2);
      fmt::print(" {} {} of {} (median error {:.2g} %);",
                 kind_names[static_cast<std::size_t>(kind)], tally.held, tally.of,
                 100 * tally.errors[tally.errors.size() / 2]);
      held += tally.held;
      of += tally.of;
    }
    fmt::print(" all {} of {}, {:.1f} %; joints called wrong: {}\n", held, of, 100.0 * held / of,
               called_wrong);
    std::fflush(stdout);
  }
};

}  // namespace

int main(int argc, char** argv) {
  constexpr std::array<std::string_view, 6> names = {"exact", "aligned", "noise",
                                                     "late",  "log",     "noisy_log"};
  const auto* const found =
      argc > 2 ? std::ranges::find(names, std::string_view(argv[1])) : names.end();
  if (found == names.end()) {
    fmt::print(stderr, "usage: identify_coverage {} ARMS [FIRST]\n", fmt::join(names, "|"));
    return 2;
  }
  Campaign campaign{static_cast<Data>(found - names.begin()), {}, 0, 0};
  const int first = argc > 3 ? std::atoi(argv[3]) : 0;
  for (int arm = first; arm < first + std::atoi(argv[2]); ++arm) {
    campaign.add(static_cast<unsigned>(arm));
    if (arm % 10 == 9) campaign.print();
  }
  campaign.print();
}
