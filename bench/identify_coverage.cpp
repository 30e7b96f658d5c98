// Measures how often the 95 % intervals of `identify` hold the true values of random arms, and how
// often a right model is called wrong. docs/identification.md has the numbers.
//
//   identify_coverage KIND ARMS [FIRST [tools]]   KIND: exact, aligned, noise, late, terms
//   (tables), log, noisy_log, log_terms
//
// With `tools` each arm is an iiwa 7 with a tool, whose mass, centre of mass and inertia are
// unknown.

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <memory>
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
/// later and are held over it. Terms are the means of arms half of whose joints have a rise of
/// friction or friction that grows with the load. A noisy log's encoders have up to 2e-4 rad of
/// noise. Logs with terms are of such arms.
enum class Data { exact, aligned, noise, late, terms, log, noisy_log, log_terms };

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

/// Draws a tool of 0.3 to 2.5 kg with the inertia of a box.
robot::MassProperties drawn_tool(std::mt19937& random) {
  const auto between = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  robot::MassProperties tool;
  tool.mass = between(0.3, 2.5);
  tool.p_Bcm << between(-0.08, 0.08), between(-0.08, 0.08), between(0.02, 0.15);
  const Eigen::Array3d square(between(0.002, 0.02), between(0.002, 0.02), between(0.002, 0.02));
  const Eigen::Vector3d moments = tool.mass / 12 * (square.sum() - square);
  const Eigen::Matrix3d R =
      Eigen::Quaterniond(between(-1, 1), between(-1, 1), between(-1, 1), between(-1, 1))
          .normalized()
          .toRotationMatrix();
  tool.I_Bcm = R * moments.asDiagonal() * R.transpose();
  return tool;
}

/// Draws a rise of friction for a third of the joints and friction by the load for another third.
void draw_terms(plant::DriveSpec& drive, std::mt19937& random) {
  const auto between = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  for (Eigen::Index j = 0; j < drive.coulomb_friction_Nm.size(); ++j) {
    const double which = between(0, 3);
    if (which < 1) {
      drive.friction_rise_Nm[j] = between(0.5, 1.5) * drive.coulomb_friction_Nm[j];
      drive.friction_rise_velocity_rad_per_s[j] = between(0.05, 0.3);
    } else if (which < 2) {
      drive.load_friction[j] = between(0.03, 0.12);
    }
  }
}

struct Campaign {
  Data data;
  bool tools;
  std::map<std::string, Tally> kinds;
  int arms = 0, called_wrong = 0, terms = 0, terms_found = 0, terms_wrong = 0;

  /// Counts an interval.
  /// @param name of the kind and of the number
  void count(const std::string& kind, const std::string& name, double error, double half_width,
             double truth) {
    Tally& tally = kinds[kind];
    tally.held += error <= half_width ? 1 : 0;
    ++tally.of;
    tally.errors.push_back(error / std::abs(truth));
    if (error > half_width && std::getenv("MISSES") != nullptr) {
      fmt::print("  {} off by {:.3g} of it, {:.2g} half widths\n", name, error / std::abs(truth),
                 error / half_width);
    }
  }

  void add_tool(const robot::MassProperties& tool, const Load& load, const std::string& arm) {
    count("tool's mass", arm + "mass", std::abs(load.mass - tool.mass), load.mass_half_width,
          tool.mass);
    const Eigen::Matrix3d& I = tool.I_Bcm;
    const Load::Six inertia = {I(0, 0), I(0, 1), I(0, 2), I(1, 1), I(1, 2), I(2, 2)};
    for (Eigen::Index i = 0; i < 3; ++i) {
      if (!std::isfinite(load.centre_half_width[i])) continue;
      count("centre", arm + "centre " + "xyz"[i], std::abs(load.centre[i] - tool.p_Bcm[i]),
            load.centre_half_width[i], tool.p_Bcm.norm());
    }
    for (Eigen::Index i = 0; i < 6; ++i) {
      if (!std::isfinite(load.inertia_half_width[i])) continue;
      count("inertia", arm + "inertia", std::abs(load.inertia[i] - inertia[i]),
            load.inertia_half_width[i], I.trace());
    }
  }

  /// Returns the kind under which a number of the arm counts. Joints with a term of friction that
  /// was not found count by themselves.
  static std::string kind_of(const Identified& found, const Identified::Parameter& number,
                             const plant::DriveSpec& drive) {
    std::string kind(kind_names[static_cast<std::size_t>(number.entry.kind)]);
    const Eigen::Index joint = number.entry.joint;
    if (joint < 0) return kind;
    const auto is_found = [&](Kind term) {
      return std::ranges::any_of(found.parameters, [&](const Identified::Parameter& each) {
        return each.entry.kind == term && each.entry.joint == joint;
      });
    };
    const bool all_found = (drive.friction_rise_Nm[joint] == 0 || is_found(Kind::rise)) &&
                           (drive.load_friction[joint] == 0 || is_found(Kind::load_friction));
    return all_found ? kind : kind + " where a term was not found";
  }

  /// Counts the terms of friction that were found, and their intervals.
  void add_terms(const Identified& found, const plant::DriveSpec& drive, const std::string& arm) {
    terms += static_cast<int>((drive.friction_rise_Nm.array() != 0).count() +
                              (drive.load_friction.array() != 0).count());
    for (const Identified::Parameter& each : found.parameters) {
      if (!is_term(each.entry.kind)) continue;
      const Vector& of_kind =
          each.entry.kind == Kind::rise ? drive.friction_rise_Nm : drive.load_friction;
      const double truth = of_kind[each.entry.joint];
      if (truth == 0) {
        ++terms_wrong;
        continue;
      }
      ++terms_found;
      count(std::string(kind_names[static_cast<std::size_t>(each.entry.kind)]),
            arm + each.entry.name, std::abs(each.value - truth), each.half_width, truth);
    }
  }

  void add(unsigned seed) {
    std::mt19937 random(seed + 77000);
    const bool is_log = data == Data::log || data == Data::noisy_log || data == Data::log_terms;
    const bool has_terms = data == Data::terms || data == Data::log_terms;
    const char* const robot = seed % 3 != 2 && !tools ? "practical_rigid" : "iiwa_point_to_point";
    const std::string bits = std::to_string(is_log ? 14 + 2 * (seed % 4) : 16 + 2 * (seed % 4 % 3));
    scenario::Scenario believed = identify::scenario(robot, bits, 15);
    if (data == Data::noisy_log) {
      believed.plant.encoder.noise_std_rad = 5e-5 * static_cast<double>(seed % 5);
    }
    const Parameters parameters(believed, all);
    Eigen::VectorXd truth = draw_truth(believed, parameters, random);
    robot::MassProperties tool;
    // In tables friction by the load is a share of the known robot's gravity torque.
    const bool has_payload = !tools && data != Data::terms;
    if (!has_payload) truth[truth.size() - 1] = believed.plant.payload.mass_kg = 0;
    if (has_terms) {
      constexpr double larger = 5;  // real arms have more friction
      truth.segment(parameters.first(Kind::coulomb), believed.num_joints) *= larger;
    }
    if (tools) {
      believed.plant.payload.link = believed.model->bodies.back().link;
      tool = drawn_tool(random);
    }
    scenario::Scenario plant = hidden(believed, truth);
    if (tools) {
      plant.model = std::make_shared<robot::Model>(
          robot::with_payload(*plant.model, tool, believed.plant.payload.link));
    }
    if (has_terms) draw_terms(plant.plant.drive, random);
    Recording run =
        data == Data::exact ? exact_table(believed, plant, seed) : record(believed, plant);
    std::vector<Kind> unknown = all;
    if (!has_payload) unknown.pop_back();
    if (tools) unknown.push_back(Kind::load);
    if (!is_log) {
      if (data != Data::exact) run = table_of(run, data, random);
      unknown.push_back(Kind::delay);
    }
    const Identified found = identify::identify({run}, unknown, {}, ignore);
    ++arms;
    for (const Identified::Check& each : found.checks) called_wrong += each.misfit.found;
    const std::string arm = fmt::format("arm {} {} {} bits: ", seed, robot, bits);
    const Eigen::Index own = truth.size() - (has_payload ? 0 : 1);
    for (Eigen::Index i = 0; i < own; ++i) {
      const Identified::Parameter& each = found.parameters[static_cast<std::size_t>(i)];
      count(kind_of(found, each, plant.plant.drive), arm + each.entry.name,
            std::abs(each.value - truth[i]), each.half_width, truth[i]);
    }
    if (tools) add_tool(tool, *found.load, arm);
    add_terms(found, plant.plant.drive, arm);
  }

  void print() {
    int held = 0, of = 0;
    fmt::print("{} arms:", arms);
    for (auto& [kind, tally] : kinds) {
      std::ranges::nth_element(tally.errors, tally.errors.begin() + std::ssize(tally.errors) / 2);
      fmt::print(" {} {} of {} (median error {:.2g} %);", kind, tally.held, tally.of,
                 100 * tally.errors[tally.errors.size() / 2]);
      held += tally.held;
      of += tally.of;
    }
    fmt::print(" all {} of {}, {:.1f} %; joints called wrong: {}\n", held, of, 100.0 * held / of,
               called_wrong);
    fmt::print("{} terms of friction: {} found, {} where there is none\n", terms, terms_found,
               terms_wrong);
    std::fflush(stdout);
  }
};

}  // namespace

int main(int argc, char** argv) {
  constexpr std::array<std::string_view, 8> names = {"exact", "aligned", "noise",     "late",
                                                     "terms", "log",     "noisy_log", "log_terms"};
  const auto* const found =
      argc > 2 ? std::ranges::find(names, std::string_view(argv[1])) : names.end();
  if (found == names.end()) {
    fmt::print(stderr, "usage: identify_coverage {} ARMS [FIRST [tools]]\n", fmt::join(names, "|"));
    return 2;
  }
  const bool tools = argc > 4 && std::string_view(argv[4]) == "tools";
  Campaign campaign{static_cast<Data>(found - names.begin()), tools, {}};
  const int first = argc > 3 ? std::atoi(argv[3]) : 0;
  for (int arm = first; arm < first + std::atoi(argv[2]); ++arm) {
    campaign.add(static_cast<unsigned>(arm));
    if (arm % 10 == 9) campaign.print();
  }
  campaign.print();
}
