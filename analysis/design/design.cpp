#include "design/design.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <numbers>
#include <numeric>
#include <utility>

#include "base/failure.h"
#include "base/parallel.h"
#include "certify/feasibility.h"
#include "controller/registry.h"
#include "design/adaptation.h"
#include "design/design_problem.h"
#include "design/gain_point.h"
#include "design/gain_search.h"
#include "design/time_left.h"
#include "linear/law_answers.h"
#include "linear/linear_loop.h"
#include "numerics/postures.h"
#include "robot/model.h"

namespace tachless::design {

namespace {

using base::ExitCode;
using base::Failure;
using base::parallel_map;
using Eigen::Index;
using Eigen::VectorXd;
using messages::ReferencePoint;

// These numbers decide how long a search takes and which good gains it ends at. Whether the gains
// keep the margin is decided by `search_range` and the prediction of the result alone. Postures in
// the joints' range: those looked through for a low modulus, those that a search begins with, and
// those added at once. The pool shows what one posture in some hundred has; a loop more makes each
// step longer.
constexpr int pool_size = 400, first_postures = 16, most_added = 3;
// Between two rounds: short descents from the worst postures of the pool.
constexpr int searched_postures = 6, search_evaluations = 50, rounds = 6;
// Caps of the steps, which end by themselves when none promises more (gain_search.cpp).
constexpr int steps_of_a_start = 20, steps_of_a_round = 40, most_attempts = 8;
// Number of the starts that ask for half of the margin. The text about the time left counts them.
constexpr int most_starts = 4;
// The least modulus over the joints' range: descents from the worst of fresh postures, until two
// sets of descents agree.
constexpr double uncertain_share = 0.1;  // postures of each uncertain plant, of the scenario's
constexpr int fresh_postures = 400, fresh_apart = 10'000, descents = 8, descent_evaluations = 300,
              most_sets = 8;
constexpr double same_posture = 0.05;  // [rad; m] two descents that end this near are one posture
constexpr double sets_agree = 1.02;    // ratio of the least moduli of two sets
// A search is short if its gains settle this much later than the gains of another structure.
// Longer searches shorten settling by less than half.
constexpr double dominated = 3;
constexpr int short_rounds = 2;
// How often the bandwidth is halved in search of gains that keep the margin.
constexpr int most_softened = 8;
constexpr double slower = 1.02;  // least factor of the settling time by which a posture is added
constexpr double eased_hz = 1;   // bandwidth with which remedies are tried
// Bandwidths of the searches for softer gains, each half of the one before [Hz].
constexpr double softest_start_hz = 20, least_bandwidth_hz = 0.1;
constexpr double useless_share = 0.1;       // of a joint's motion that friction may take from it
constexpr double margin_tolerance = 0.002;  // numbers are printed with two digits

/// @throw Failure(bad_usage) for flexible joints, whose rotors are no part of the links' model
void require_rigid(const scenario::Scenario& scenario) {
  if (!scenario.robot.flexible) return;
  throw Failure(ExitCode::bad_usage,
                "--uncertain: {} has flexible joints; allowed: a robot with rigid ones",
                scenario.robot.name);
}

class Search {
 public:
  Search(const scenario::Scenario& scenario, const DesignGoal& goal,
         const linear::LawAnswers& answers, const Beside& beside = {})
      : beside_(beside),
        scenario_(scenario),
        goal_(goal),
        answers_(answers),
        law_(scenario, goal, answers),
        labels_(robot::joint_labels(*scenario.model)) {
    law_.choose_variables();
    along_motion_ = law_.at(law_.first_rests());
    if (goal.uncertainty) {
      require_rigid(scenario);
      plants_ = uncertain_plants(law_.model(), *goal.uncertainty);
    }
    pool_ = pool(1000, pool_size);
    way_ = law_.at(law_.loop().rest_points(certify::reference_postures));
  }

  /// The start of a search, and the postures at which its gains have to keep the margin.
  struct Start {
    bool own = false;                    ///< at the scenario's gains; otherwise at the rule's
    std::optional<double> bandwidth_hz;  ///< upper limit beside the goal's
    bool in_range = true;  ///< over the joints' range, too; otherwise along the motion alone
  };

  /// Returns what the softest gains lack along the motion.
  [[nodiscard]] std::string lacking() {
    const std::string gains =
        answers_ ? "the scenario's gains" : fmt::format("gains of {:g} Hz", least_bandwidth_hz);
    const VectorXd theta = softest();
    if (const Lack count = GainPoint(problem_, theta).count_lack(); count.lack > 0) {
      return fmt::format(
          "with {} the torque of one encoder count on {} is {:.3g} times the "
          "largest",
          gains, labels_.joint(count.joint), std::exp(count.lack));
    }
    const std::vector<double> modulus = least_moduli(problem_, theta, 0);
    const auto least = std::ranges::min_element(modulus);
    const auto at = static_cast<std::size_t>(least - modulus.begin());
    return fmt::format("with {} the modulus margin is {:.2g} at q = {}", gains, *least,
                       certify::list_text(certify::found_posture(problem_.rests[at].q_ref)));
  }

  /// Returns true if a count's torque is too large with the softest gains, too.
  [[nodiscard]] bool count_forbids_all() {
    const VectorXd theta = softest();
    return GainPoint(problem_, theta).count_lack().lack > 0;
  }

  /// Returns true if the bound of this bandwidth excludes gains that the last searches had.
  [[nodiscard]] bool is_bounded_by(double hz) const {
    return highest_.size() == 0 || (highest_.array() > law_.upper_within(hz).array()).any();
  }

  /// Returns the design, or nothing when no gains keep the margin.
  std::optional<Design> found(const Start& from, const linear::OnProgress& tell) {
    begin(from);
    const std::vector<FoundGains> starts = good_starts(from, tell);
    if (starts.empty()) return {};
    time_left_->enter(TimeLeft::Phase::best);
    best_ = climbed("design: the best start", starts[0].theta, steps_of_a_round, tell);
    is_short_ = is_dominated(best_);
    if (starts.size() > 1 && !is_short_ && starts[1].theta != starts[0].theta) {
      time_left_->enter(TimeLeft::Phase::second);
      const FoundGains other =
          climbed("design: the second best start", starts[1].theta, steps_of_a_round, tell);
      if (other.settling_s < best_.settling_s) best_ = other;
    }
    if (answers_) try_beside(tell);
    worst_ = worst_postures();
    const int most = is_short_ ? short_rounds : rounds;
    for (int round = 0; round < most && add_worst(); ++round) {
      time_left_->enter(TimeLeft::Phase::rounds, most - round - 1);
      const FoundGains next =
          climbed(fmt::format("design: round {} of at most {}", round + 1, most), best_.theta,
                  most_steps(), tell);
      if (std::isfinite(next.settling_s) || !std::isfinite(best_.settling_s)) best_ = next;
      worst_ = worst_postures();
    }
    if (!std::isfinite(best_.settling_s) && !recovered(tell)) return {};
    if (beside_.suits) {
      Design gains_alone;
      gains_alone.gains = law_.rounded(law_.gains(best_.theta));
      if (!beside_.suits(gains_alone)) return gains_alone;
    }
    for (int attempt = 0; attempt < most_attempts; ++attempt) {
      const bool last = attempt + 1 == most_attempts || !in_range_;
      worst_.clear();  // these moduli are of other gains
      time_left_->enter(TimeLeft::Phase::range, most_attempts - attempt - 1);
      search_range(tell, last);
      if (!last && add_worst()) {
        time_left_->enter(TimeLeft::Phase::range, most_attempts - attempt - 2);
        if (!climbed_on("design: once more with the worst postures in range", tell)) break;
        continue;
      }
      Design design = result(tell);
      if (!design.loop.stable || !design.loop.margins) break;
      const double lacking = goal_.modulus - design.loop.margins->modulus;
      if (stiff_enough(design.loop.stiffness) && lacking <= margin_tolerance) return design;
      const ReferencePoint rest = linear::constant_reference(design.loop.margin_q);
      add(problem_, law_.loop_at(rest), rest, 1);
      // The margin lacks between the frequencies of the grid.
      problem_.margin += std::max(0.0, lacking);
      best_.theta = best_.theta.cwiseMax(problem_.lower);
      if (!climbed_on("design: once more with what lacked", tell)) break;
    }
    return {};
  }

 private:
  // ---- search -----------------------------------------------------------------------------------

  /// Forgets what an earlier search has added.
  void begin(const Start& from) {
    time_left_.emplace(along_motion_.same_everywhere, beside_.another_follows,
                       std::isfinite(beside_.settling_s));
    is_short_ = false;
    problem_ = along_motion_;
    if (from.bandwidth_hz) problem_.upper = law_.upper_within(*from.bandwidth_hz);
    in_range_ = from.in_range;
    in_pool_.assign(pool_.loops.size(), 0);
    on_way_.assign(way_.loops.size(), 0);
    for (std::size_t k = 0; in_range_ && k < first_postures; ++k) {
      add(problem_, pool_, k, asked_share);
      in_pool_[k] = 1;
    }
  }

  /// Returns soft gains by the rule, or the scenario's of an external law. Begins a search along
  /// the motion.
  VectorXd softest() {
    begin({.bandwidth_hz = {}, .in_range = false});
    const double w = 2 * std::numbers::pi * least_bandwidth_hz;
    const VectorXd soft = answers_ ? *law_.own_theta() : law_.theta_of(law_.by_rule(w, 20));
    return soft.cwiseMax(problem_.lower).cwiseMin(problem_.upper);
  }

  FoundGains climbed(const std::string& what, const VectorXd& theta, int steps,
                     const linear::OnProgress& tell, bool adding = true) {
    const FoundGains found = faster_gains(
        problem_, theta, steps,
        [&](GainProblem& problem, const VectorXd& here) {
          return adding && add_lacking(problem, here);
        },
        [&](int step, const FoundGains& now) {
          time_left_->step(problem_.loops.size(), steps - step - 1);
          tell(fmt::format("{}, step {}: {}, {}", what, step,
                           std::isfinite(now.settling_s)
                               ? fmt::format("settles in {}, modulus {:.3f}",
                                             certify::settling_text(now.settling_s), now.modulus)
                               : "no margin yet",
                           time_left_->text()));
        });
    for (const VectorXd& gains : {theta, found.theta}) {
      highest_ = highest_.size() == 0 ? gains : highest_.cwiseMax(gains);
    }
    return found;
  }

  /// Goes on from the best gains. Returns whether some keep the margin at the postures added.
  bool climbed_on(const std::string& what, const linear::OnProgress& tell) {
    best_ = climbed(what, best_.theta, most_steps(), tell);
    return std::isfinite(best_.settling_s) || recovered(tell);
  }

  /// Goes on from softer gains that keep the margin at all postures of the problem. Returns whether
  /// there are any.
  bool recovered(const linear::OnProgress& tell) {
    std::optional<VectorXd> softer = best_.theta;
    double modulus = 0;
    for (int k = 0; modulus < problem_.margin + margin_kept; ++k) {
      softer = law_.softer(*softer);
      if (!softer || k == most_softened) return false;
      softer = softer->cwiseMax(problem_.lower).cwiseMin(problem_.upper);
      modulus = least_modulus(problem_, *softer);
    }
    best_ = climbed("design: again from softer gains", *softer, most_steps(), tell);
    return std::isfinite(best_.settling_s);
  }

  [[nodiscard]] int most_steps() const { return is_short_ ? steps_of_a_start : steps_of_a_round; }
  /// Returns true for gains that settle much later than the gains found before.
  [[nodiscard]] bool is_dominated(const FoundGains& gains) const {
    return gains.settling_s > dominated * beside_.settling_s;
  }

  /// Restarts the search beside the best gains of an external law. The search has only one start
  /// for such a law, and the linear programmes end at the optimum nearest to their start.
  void try_beside(const linear::OnProgress& tell) {
    const std::size_t count = law_.beside(best_.theta).size();
    for (std::size_t k = 0; k < count; ++k) {
      const VectorXd start = law_.beside(best_.theta)[k];  // evaluated again because best_ changes
      if (!(judged(problem_, start).modulus > 0)) continue;
      const FoundGains other =
          climbed(fmt::format("design: beside the best, {} of {}", k + 1, count), start,
                  steps_of_a_start, tell);
      if (other.settling_s < best_.settling_s) best_ = other;
    }
  }

  static void add(GainProblem& problem, const linear::RestLoop& loop, const ReferencePoint& rest,
                  double share) {
    problem.share.push_back(share);
    problem.loops.push_back(loop);
    problem.rests.push_back(rest);
  }
  static void add(GainProblem& problem, const GainProblem& from, std::size_t which, double share) {
    add(problem, from.loops[which], from.rests[which], share);
  }

  /// Returns the least moduli at the postures of the pool, ascending, with the postures' numbers.
  [[nodiscard]] std::vector<std::pair<double, std::size_t>> worst_of_pool(
      const VectorXd& theta) const {
    const std::vector<double> modulus = least_moduli(pool_, theta, 0);
    std::vector<std::pair<double, std::size_t>> order;
    for (std::size_t k = 0; k < modulus.size(); ++k) order.emplace_back(modulus[k], k);
    std::ranges::sort(order);
    return order;
  }

  /// Adds the postures of the joints' range that lack the margin most. Also adds the posture of the
  /// motion that settles last. Returns whether it added any.
  bool add_lacking(GainProblem& problem, const VectorXd& theta) {
    const std::size_t before = problem.loops.size();
    using Order = std::vector<std::pair<double, std::size_t>>;
    for (const auto& [modulus, k] : in_range_ ? worst_of_pool(theta) : Order()) {
      if (modulus >= asked_share * problem.margin || problem.loops.size() == before + most_added)
        break;
      if (!std::exchange(in_pool_[k], 1)) add(problem, pool_, k, asked_share);
    }
    const std::vector<double> settling = settling_times(way_, theta);
    double known = 0;
    for (std::size_t k = 0; k < settling.size(); ++k) {
      const bool first = k == 0 || k + 1 == settling.size() || 2 * k + 1 == settling.size();
      if (on_way_[k] || first) known = std::max(known, settling[k]);
    }
    const auto last =
        static_cast<std::size_t>(std::ranges::max_element(settling) - settling.begin());
    if (settling[last] > slower * known) {
      on_way_[last] = 1;
      problem.settling.push_back(problem.loops.size());
      add(problem, way_, last, 1);
    }
    return problem.loops.size() > before;
  }

  /// Returns the gains that a few steps from each start reach, the fastest first. The starts are
  /// gains by the rule, with joint inertias for free other joints or halfway to held ones. Each
  /// start takes the largest w that has half the margin. If none of these succeeds, it takes the
  /// largest w that has the whole margin. If a rule never reaches it, its start takes the w with
  /// the largest modulus.
  std::vector<FoundGains> good_starts(const Start& from, const linear::OnProgress& tell) {
    if (from.own) {
      const auto own = law_.own_theta();
      const FoundGains given = own ? judged(problem_, *own) : FoundGains();
      if (given.modulus > 0) return {given};
      if (!answers_) return {};
      throw Failure(ExitCode::check_said_no,
                    "design starts from the scenario's controller.gains, and the loop is unstable "
                    "with them at a posture of the motion or in range: begin with softer ones");
    }
    // A filter at 4 w lags by 14 degrees at w, and a filter at 20 w by 3 degrees. The torque per
    // encoder count grows with the filter. Half of the margin is enough for a start, since the
    // climb raises the margin. The other starts ask for 2 % more than the margin, which includes
    // `margin_kept`. The last rule has filters at the sampling rate and three times the damping,
    // for loops to which a filter's lag leaves no margin.
    struct Rule {
      double filter_ratio, damping, part_of_margin, held;
    };
    constexpr std::array starts = {Rule{4, 1, 0.5, 0.5}, Rule{20, 1, 0.5, 0.5},
                                   Rule{4, 1, 0.5, 0},   Rule{20, 1, 0.5, 0},
                                   Rule{20, 1, 1.02, 0}, Rule{1e9, 3, 1.02, 0}};
    std::vector<FoundGains> all;
    std::vector<std::pair<VectorXd, FoundGains>> known;  // begins of the climbs, and their ends
    for (const Rule& start : starts) {
      if (start.part_of_margin > 1 && !all.empty()) break;
      if (std::ranges::any_of(all, [&](const FoundGains& each) { return is_dominated(each); }))
        break;
      const auto gains_at = [&](double w) -> VectorXd {
        return law_
            .theta_of(
                law_.by_rule(w, start.filter_ratio, {.damping = start.damping, .held = start.held}))
            .cwiseMax(problem_.lower)
            .cwiseMin(problem_.upper);
      };
      const double rate = 1 / scenario_.loop.period_s;
      double best_w = 0, modulus = 0;
      const double fastest = 2 * std::numbers::pi * from.bandwidth_hz.value_or(infinity);
      // At w = 0.2 rate, the hold and one tick of delay take 17 degrees of phase. A factor of 1.5
      // on w is 2.25 on kp: one of the climb's largest steps.
      for (double w = 0.2 * rate; w > 1e-5 * rate; w /= 1.5) {
        if (w > 2 * fastest) continue;
        const double here = least_modulus(problem_, gains_at(w));
        if (here > modulus) {
          modulus = here;
          best_w = w;
        }
        if (modulus > start.part_of_margin * goal_.modulus) break;
      }
      if (best_w == 0) continue;
      const VectorXd begin = gains_at(best_w);
      const auto same = std::ranges::find(known, begin, &std::pair<VectorXd, FoundGains>::first);
      if (same != known.end()) {
        if (std::isfinite(same->second.settling_s)) all.push_back(same->second);
        continue;
      }
      const bool enough = modulus > start.part_of_margin * goal_.modulus;
      time_left_->enter(TimeLeft::Phase::starts,
                        std::max(0, most_starts - static_cast<int>(&start - starts.data()) - 1));
      const FoundGains here = climbed(
          fmt::format("design: start {} of at most {}", &start - starts.data() + 1, starts.size()),
          begin, enough ? steps_of_a_start : steps_of_a_round, tell, false);
      known.emplace_back(begin, here);
      if (std::isfinite(here.settling_s)) all.push_back(here);
    }
    std::ranges::stable_sort(all, {}, &FoundGains::settling_s);
    return all;
  }

  /// Returns loops in the joints' range: `count` with the scenario's plant, then a part of it with
  /// each plant of the uncertain set.
  [[nodiscard]] GainProblem pool(int first, int count) const {
    const auto nominal = static_cast<std::size_t>(count);
    const std::size_t others = plants_.size() * uncertain_postures(nominal);
    GainProblem pool = law_.at({});
    for (std::size_t k = 0; k < nominal + others; ++k) {
      pool.rests.push_back(rest_in_range(law_.model(), first + 1 + static_cast<int>(k)));
    }
    pool.loops = parallel_map(pool.rests.size(), [&](std::size_t k) {
      return law_.loop_at(pool.rests[k], plant_of_pool(k, nominal));
    });
    pool.share.assign(pool.rests.size(), 1);
    return pool;
  }
  static std::size_t uncertain_postures(std::size_t nominal) {
    return static_cast<std::size_t>(static_cast<double>(nominal) * uncertain_share);
  }
  /// Returns the plant of a loop of a pool with so many loops of the scenario's plant; null: that.
  [[nodiscard]] const UncertainPlant* plant_of_pool(std::size_t k, std::size_t nominal) const {
    return k < nominal ? nullptr : &plants_[(k - nominal) / uncertain_postures(nominal)];
  }

  /// A posture with a low modulus, and the plant that has it; null: the scenario's.
  struct Worst : numerics::Minimum {
    const UncertainPlant* plant = nullptr;
  };

  /// Descends from a posture to one with a lower modulus.
  [[nodiscard]] Worst descended(const LeastModulus& least, const VectorXd& from,
                                const UncertainPlant* plant, int evaluations) const {
    const robot::Model& model = law_.model();
    const auto modulus = [&](const VectorXd& q, const std::vector<double>& among) {
      const ReferencePoint rest = linear::constant_reference(q);
      return least.at(law_.loop_at(rest, plant, true), rest, problem_.margin + near_margin, among);
    };
    // The frequencies of a resonance move with the posture.
    std::vector<double> lowest;
    if (!problem_.resonant) {
      const ReferencePoint rest = linear::constant_reference(from);
      lowest = least.lowest(law_.loop_at(rest, plant, true), rest);
    }
    numerics::Minimum end = numerics::minimise(
        [&](const VectorXd& q) {
          // Outside the joints' ranges.
          if ((q - model.lower).minCoeff() < 0 || (model.upper - q).minCoeff() < 0) return 2.0;
          return modulus(q, lowest);
        },
        from, 0.3, evaluations);
    if (!lowest.empty()) end.value = modulus(end.x, {});
    return {end, plant};
  }

  /// Searches for the postures with the least modulus, starting from the worst of the pool.
  [[nodiscard]] std::vector<Worst> worst_postures() const {
    const auto order = worst_of_pool(best_.theta);
    const LeastModulus least(problem_, best_.theta);
    return parallel_map(searched_postures, [&](std::size_t k) {
      const std::size_t from = order[k].second;
      return descended(least, pool_.rests[from].q_ref, plant_of_pool(from, pool_size),
                       search_evaluations);
    });
  }

  /// Searches the joints' range for the least modulus with fresh postures, and adds what it finds
  /// to `worst_`. Ends when two sets of descents agree.
  /// @param whole otherwise it ends when a posture lacks the margin, too
  void search_range(const linear::OnProgress& tell, bool whole) {
    const LeastModulus least(problem_, best_.theta);
    double before = infinity;
    for (int set = 0; set < most_sets; ++set) {
      tell(fmt::format("design: least modulus in the joints' range, set {} of at most {}, {}",
                       set + 1, most_sets, time_left_->text()));
      while (std::ssize(fresh_) <= set) {
        fresh_.push_back(pool(static_cast<int>(fresh_.size() + 1) * fresh_apart, fresh_postures));
      }
      const GainProblem& fresh = fresh_[static_cast<std::size_t>(set)];
      const std::vector<double> modulus = least_moduli(fresh, best_.theta, 0);
      std::vector<std::size_t> starts = least_of(modulus, 0, fresh_postures);
      if (!plants_.empty()) {
        const std::vector<std::size_t> others = least_of(modulus, fresh_postures, modulus.size());
        starts.insert(starts.end(), others.begin(), others.end());
      }
      const auto found = parallel_map(starts.size(), [&](std::size_t k) {
        return descended(least, fresh.rests[starts[k]].q_ref,
                         plant_of_pool(starts[k], fresh_postures), descent_evaluations);
      });
      worst_.insert(worst_.end(), found.begin(), found.end());
      time_left_->set();
      const double here = std::ranges::min_element(found, {}, &Worst::value)->value;
      if (std::max(here, before) <= sets_agree * std::min(here, before)) return;
      if (!whole && lacks(here)) return;
      before = std::min(here, before);
    }
  }

  /// Returns the indices of the least numbers from `begin` to before `end`.
  static std::vector<std::size_t> least_of(const std::vector<double>& numbers, std::size_t begin,
                                           std::size_t end) {
    std::vector<std::size_t> order(end - begin);
    std::iota(order.begin(), order.end(), begin);
    std::ranges::partial_sort(order, order.begin() + descents, {},
                              [&](std::size_t k) { return numbers[k]; });
    order.resize(descents);
    return order;
  }

  /// Returns true for a modulus at a posture outside the motion that is below the margin there.
  [[nodiscard]] bool lacks(double modulus) const { return modulus < range_share * problem_.margin; }
  [[nodiscard]] const Worst& worst() const {
    return *std::ranges::min_element(worst_, {}, &Worst::value);
  }
  /// Adds the worst postures that lack the margin asked of them, if the very worst lacks
  /// `range_share` of it. Returns whether it added any.
  bool add_worst() {
    if (!in_range_ || !lacks(worst().value)) return false;
    std::ranges::sort(worst_, {}, &Worst::value);
    std::vector<Worst> added;
    for (const Worst& each : worst_) {
      if (each.value >= asked_share * problem_.margin || added.size() == searched_postures) break;
      const bool known = std::ranges::any_of(added, [&](const Worst& other) {
        return other.plant == each.plant && (other.x - each.x).cwiseAbs().maxCoeff() < same_posture;
      });
      if (known) continue;
      added.push_back(each);
      const ReferencePoint rest = linear::constant_reference(each.x);
      add(problem_, law_.loop_at(rest, each.plant), rest, asked_share);
    }
    return true;
  }

  /// Returns whether the joints are as stiff as asked. If not, raises the lower bound on kp by what
  /// the springs in series leave to it.
  bool stiff_enough(const Eigen::ArrayXd& stiffness) {
    if (!goal_.least_kp || (stiffness > 0.999 * goal_.least_kp->array()).all()) return true;
    const Eigen::ArrayXd asked = *goal_.least_kp, theta = best_.theta.head(asked.size());
    problem_.lower.head(asked.size()) =
        -(1 / asked - 1 / stiffness + (-theta).exp()).max(1e-30).log();
    return false;
  }

  // ---- result -----------------------------------------------------------------------------------

  [[nodiscard]] std::string words(const Binding& binding) const {
    const double percent = 100 * binding.settling_share;
    const auto shortens = [percent](const std::string& what) {
      return fmt::format("{} shortens settling by {:.{}f} %", what, percent, percent < 1 ? 1 : 0);
    };
    if (binding.kind == Binding::Kind::bound)
      return shortens("the bound on " + law_.name_of(binding.which) + ": one a tenth wider");
    if (binding.kind == Binding::Kind::count) {
      return shortens("the torque of one encoder count on " + labels_.joint(binding.which) +
                      ": one a tenth larger");
    }
    return shortens(fmt::format(
        "the modulus margin at q = {}: one a tenth smaller",
        certify::list_text(certify::found_posture(problem_.rests[binding.which].q_ref))));
  }

  [[nodiscard]] Design result(const linear::OnProgress& tell) const {
    Design design;
    design.gains = law_.rounded(law_.gains(best_.theta));
    for (const Binding& each : bindings(problem_, best_)) design.binds.push_back(words(each));
    const scenario::Scenario scenario = law_.with(design.gains);
    design.loop = certify::analyse(scenario, linear::Effort::margins, tell, answers_);
    const auto least_with = [&](bool nominal) -> const Worst& {
      return *std::ranges::min_element(worst_, {}, [&](const Worst& each) {
        return (each.plant == nullptr) == nominal ? each.value : infinity;
      });
    };
    design.modulus_in_range = least_with(true).value;
    design.asked_in_range = range_share * goal_.modulus;
    design.range_q = certify::found_posture(least_with(true).x);
    if (!plants_.empty()) {
      const Worst& least = least_with(false);
      design.uncertain_modulus = least.value;
      design.uncertain_q = certify::found_posture(least.x);
      design.uncertain_plant = least.plant->name;
    }
    const auto warn = [&](double modulus, const Vector& q, const std::string& plant) {
      const double asked = range_share * goal_.modulus;
      if (modulus >= asked - margin_tolerance) return;
      design.warnings.push_back(
          fmt::format("the modulus margin is {:.2g} at q = {}, in the joints' range{}, and {:.2g} "
                      "is asked for there: keep away from it, or ask for less (--bandwidth, "
                      "--stiffness)",
                      modulus, certify::list_text(q), plant, asked));
    };
    warn(design.modulus_in_range, design.range_q, "");
    if (design.uncertain_modulus) {
      warn(*design.uncertain_modulus, design.uncertain_q, ", with " + design.uncertain_plant);
    }
    add_warnings(design);
    return design;
  }

  void add_warnings(Design& design) const {
    const Vector &stiffness = design.loop.stiffness, &stuck = design.loop.rest_error;
    const Vector& viscous = scenario_.plant.drive.viscous_friction_Nms_per_rad;
    const Vector count = scenario::encoder_count(scenario_, *scenario_.model);
    const std::vector<ReferencePoint> on_the_way =
        law_.loop().rest_points(certify::reference_postures);
    for (Index j = 0; j < stiffness.size(); ++j) {
      const std::string name = labels_.joint(static_cast<std::size_t>(j));
      const auto [least, most] =
          std::ranges::minmax(on_the_way, {}, [j](const ReferencePoint& r) { return r.q_ref[j]; });
      const double motion = most.q_ref[j] - least.q_ref[j];
      if (stuck.size() > 0 && stuck[j] > 0.01 * motion) {
        const bool useless = stuck[j] > useless_share * motion;
        (useless ? design.objections : design.warnings)
            .push_back(fmt::format("{} stops up to {:.2g} {} beside its goal, by dry friction over "
                                   "a stiffness of {:.3g}; its motion is {:.2g}",
                                   name, stuck[j], labels_.length[static_cast<std::size_t>(j)],
                                   stiffness[j], motion));
      }
      const auto [low, high] = robot::finite_range(*scenario_.model, static_cast<int>(j));
      const double whole = stiffness[j] * (high - low), noise = problem_.most_gain[j] * count[j];
      if (std::isfinite(noise) && whole < noise) {
        design.warnings.push_back(fmt::format(
            "{} is too soft: an error of its whole range ({:.3g} {}) makes {:.2g} {}, less than "
            "one encoder count may make ({:.2g}): state its rotor's inertia (--rotors typical, or "
            "robot.joint_parameters)",
            name, high - low, labels_.length[static_cast<std::size_t>(j)], whole,
            labels_.effort[static_cast<std::size_t>(j)], noise));
      }
      const double w = std::sqrt(stiffness[j] / law_.mean_inertia()[j]);
      if (viscous.size() > 0 && 3 * stiffness[j] < w * viscous[j]) {
        design.warnings.push_back(
            fmt::format("{} is slowed by its viscous friction of {:g}: a pole at {:.2g} 1/s", name,
                        viscous[j], stiffness[j] / viscous[j]));
      }
    }
  }

  Beside beside_;
  const scenario::Scenario& scenario_;
  DesignGoal goal_;
  linear::LawAnswers answers_;
  DesignProblem law_;
  robot::JointLabels labels_;
  GainProblem along_motion_;  ///< with a few postures of the motion alone
  GainProblem problem_;
  bool in_range_ = true;                ///< the margin is to be kept over the joints' range
  GainProblem pool_, way_;              ///< loops in the joints' range; loops along the motion
  std::vector<GainProblem> fresh_;      ///< sets of loops in the joints' range
  std::vector<char> in_pool_, on_way_;  ///< whether each of these loops is in the problem
  FoundGains best_;
  bool is_short_ = false;               ///< the gains of another structure settle much sooner
  VectorXd highest_;                    ///< the largest of each variable in all searches
  std::vector<UncertainPlant> plants_;  ///< beside the scenario's
  std::vector<Worst> worst_;            ///< least moduli of the best gains, with their postures
  std::optional<TimeLeft> time_left_;   ///< of the present search
};

/// Returns true if the option that asks for less leads to gains along the motion. Soft gains are
/// tried, because they are found soonest.
bool helps(const scenario::Scenario& scenario, DesignGoal goal, const linear::OnProgress& tell) {
  goal.bandwidth_hz = std::min(goal.bandwidth_hz.value_or(eased_hz), eased_hz);
  try {
    return Search(scenario, goal, {})
        .found({.bandwidth_hz = {}, .in_range = false}, tell)
        .has_value();
  } catch (const Failure&) {  // --bandwidth opposes --stiffness
    return false;
  }
}

/// Returns what to do about joints whose ranges are so wide that no gains suit one encoder count,
/// as a half sentence; empty if there are none.
std::string remedy_of_ranges(const scenario::Scenario& scenario) {
  constexpr double coarsest = 0.1;  // [rad; m] encoders of arms have counts below 0.01
  const Vector count = scenario::encoder_count(scenario, *scenario.model);
  std::vector<std::string> wide;
  for (std::size_t j = 0; j < scenario.model->joint_names.size(); ++j) {
    if (!(count[static_cast<Index>(j)] > coarsest)) continue;
    wide.push_back(scenario.model->joint_names[j] + ": 0");
  }
  if (wide.empty()) return "";
  return fmt::format(
      "one count is a step of the joint's whole range, which is too wide: correct its limits, or "
      "hold the joint: --set 'robot.locked={{{}}}'",
      fmt::join(wide, ", "));
}

/// Returns what to do, as a half sentence. Gains were found with the options that it names.
std::string remedy(const scenario::Scenario& scenario, const DesignGoal& goal,
                   const linear::OnProgress& tell) {
  if (std::string ranges = remedy_of_ranges(scenario); !ranges.empty()) return ranges;
  DesignGoal eased = goal;
  const std::string bandwidth = fmt::format("--bandwidth {:g}", eased_hz);
  if (goal.least_kp) {
    eased.least_kp.reset();
    if (helps(scenario, eased, tell)) {
      return "gains are found with " + bandwidth + " and without --stiffness and --rest-error";
    }
  }
  for (const double share : {0.7, 0.4}) {
    eased.modulus = share * goal.modulus;
    if (!helps(scenario, eased, tell)) continue;
    return fmt::format("gains are found with --margin {:.2g} {}{}", eased.modulus, bandwidth,
                       goal.least_kp ? " and without --stiffness and --rest-error" : "");
  }
  return "a smaller --margin does not help: allow a shorter period, less delay or a finer encoder";
}

/// Returns true if no gains of that bandwidth settle as fast: 4 / w is less than any damping
/// reaches.
bool is_faster_than(const Design& design, double hz) {
  return design.loop.modes.settling_s < 4 / (2 * std::numbers::pi * hz);
}

/// Returns the fastest design found, or nothing. A search from the rule comes first. If it finds no
/// gains, the scenario's own gains and softer rules are tried. If these find none either, the
/// margin is kept along the motion alone.
std::optional<Design> best_design(const scenario::Scenario& scenario, const DesignGoal& goal,
                                  const linear::OnProgress& tell, const linear::LawAnswers& answers,
                                  const Beside& beside) {
  Search search(scenario, goal, answers, beside);
  if (answers) return search.found({.own = true, .bandwidth_hz = {}}, tell);
  std::optional<Design> best = search.found({}, tell);
  if (best || search.count_forbids_all()) return best;
  if (!scenario.controller.gains.empty()) {
    best = search.found({.own = true, .bandwidth_hz = {}}, tell);
  }
  // Below its springs' resonances and the encoders' counts, a loop may keep the margin that it
  // lacks where the search from the rule begins.
  const double first = std::min(goal.bandwidth_hz.value_or(softest_start_hz), softest_start_hz);
  for (double hz = first / 2; !goal.least_kp && hz >= least_bandwidth_hz; hz /= 2) {
    if (best && is_faster_than(*best, hz)) break;
    if (!search.is_bounded_by(hz)) continue;  // the search would be the same
    std::optional<Design> softer = search.found({.bandwidth_hz = hz}, tell);
    if (!softer) continue;
    softer->warnings.push_back(
        fmt::format("no gains of more than {:.3g} Hz were found: these are soft", hz));
    if (!best || softer->loop.modes.settling_s < best->loop.modes.settling_s) best = softer;
    break;
  }
  if (best) return best;
  return search.found({.bandwidth_hz = {}, .in_range = false}, tell);
}

/// Returns the design of a law that has a linear model.
Design linear_design(const scenario::Scenario& scenario, const DesignGoal& goal,
                     const linear::OnProgress& tell, const linear::LawAnswers& answers,
                     const Beside& beside) {
  const certify::Feasibility feasible = certify::feasibility(scenario);
  if (!feasible.impossible.empty()) {
    throw Failure(ExitCode::check_said_no, feasible.impossible.front());
  }
  if (!answers) require_rule(scenario);
  std::optional<Design> best;
  try {
    best = best_design(scenario, goal, tell, answers, beside);
  } catch (const linear::NoLinearModel& why) {
    throw Failure(ExitCode::check_said_no, "no model of the law: {}", why.what());
  }
  if (!best) {
    throw Failure(ExitCode::check_said_no,
                  "no gains were found that keep a modulus margin of {:g} along the motion within "
                  "the torque of an encoder count{}: {}; {}",
                  goal.modulus, goal.least_kp ? " and the stiffness asked for" : "",
                  Search(scenario, goal, answers).lacking(),
                  answers ? "allow a shorter period, less delay, a finer encoder or a smaller "
                            "--margin"
                          : remedy(scenario, goal, tell));
  }
  if (goal.settling_s &&
      best->loop.modes.settling_s >
          std::max(*goal.settling_s + scenario.loop.period_s, 1.01 * *goal.settling_s)) {
    best->missed = goal.settling_s;
  }
  return *best;
}

}  // namespace

Design design(const scenario::Scenario& scenario, const DesignGoal& goal,
              const linear::OnProgress& tell, const linear::LawAnswers& answers,
              const Beside& beside) {
  if (answers || !adapts(scenario)) {
    return linear_design(scenario, goal, tell, answers, beside);
  }
  Design found = linear_design(with_constant_estimates(scenario), goal, tell, answers, beside);
  tell("design: rates and weights of the adaptation");
  add_adaptation(scenario, found);
  return found;
}

std::vector<std::string> overrides_of(const Design& design, const std::string& law) {
  Index n = max_joints;
  for (const auto& [name, value] : design.gains) n = std::min(n, value.size());
  std::vector<std::string> all;
  if (!law.empty()) all = {"controller.gains={}", "controller.law=" + law};
  for (const auto& [name, value] : design.gains) {
    std::vector<std::string> rows;
    for (Index row = 0; row < value.size(); row += n) {
      const bool one = value.size() == n && (value.array() == value[0]).all();
      const Vector numbers = value.segment(row, one ? 1 : n);
      const std::string text = fmt::format("{}", fmt::join(numbers.begin(), numbers.end(), ", "));
      rows.push_back(one ? text : "[" + text + "]");
    }
    all.push_back(
        fmt::format("controller.gains.{}={}", name,
                    rows.size() == 1 ? rows[0] : fmt::format("[{}]", fmt::join(rows, ", "))));
  }
  return all;
}

}  // namespace tachless::design
