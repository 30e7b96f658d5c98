#include "numerics/linear_programme.h"

#include <coin/Clp_C_Interface.h>

#include <algorithm>
#include <limits>
#include <memory>
#include <numeric>

namespace tachless::numerics {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Returns the optimum of the programme with these of its rows alone.
std::optional<Optimum> optimum_of(const LinearProgramme& programme, const std::vector<Index>& of) {
  const Index columns = programme.cost.size();
  std::vector<CoinBigIndex> start;
  std::vector<int> row_of;
  std::vector<double> value, least, none(of.size(), std::numeric_limits<double>::max());
  for (const Index i : of) least.push_back(programme.rows[static_cast<std::size_t>(i)].least);
  for (Index j = 0; j < columns; ++j) {
    start.push_back(static_cast<CoinBigIndex>(value.size()));
    for (std::size_t k = 0; k < of.size(); ++k) {
      const double entry = programme.rows[static_cast<std::size_t>(of[k])].gradient[j];
      if (entry == 0) continue;
      row_of.push_back(static_cast<int>(k));
      value.push_back(entry);
    }
  }
  start.push_back(static_cast<CoinBigIndex>(value.size()));
  const std::unique_ptr<Clp_Simplex, decltype(&Clp_deleteModel)> model(Clp_newModel(),
                                                                       &Clp_deleteModel);
  Clp_setLogLevel(model.get(), 0);
  Clp_loadProblem(model.get(), static_cast<int>(columns), static_cast<int>(of.size()), start.data(),
                  row_of.data(), value.data(), programme.lower.data(), programme.upper.data(),
                  programme.cost.data(), least.data(), none.data());
  Clp_dual(model.get(), 0);
  if (Clp_status(model.get()) != 0) return {};
  Optimum found{Eigen::Map<const VectorXd>(Clp_primalColumnSolution(model.get()), columns),
                VectorXd::Zero(std::ssize(programme.rows))};
  const double* const price = Clp_dualRowSolution(model.get());
  for (std::size_t k = 0; k < of.size(); ++k) found.price[of[k]] = price[k];
  return found;
}

}  // namespace

std::optional<Optimum> solution(const LinearProgramme& programme) {
  std::vector<Index> all(programme.rows.size());
  std::iota(all.begin(), all.end(), 0);
  return optimum_of(programme, all);
}

// A basis of the simplex method has a row for each row of the programme. At the optimum no more
// rows than variables bind.
std::optional<Optimum> solution_of_many_rows(const LinearProgramme& programme) {
  constexpr double tolerance = 1e-7;  // that of Clp
  const std::ptrdiff_t at_a_time = 4 * programme.cost.size();
  MatrixXd gradients(std::ssize(programme.rows), programme.cost.size());
  VectorXd least(gradients.rows());
  for (Index i = 0; i < gradients.rows(); ++i) {
    const LinearProgramme::Row& row = programme.rows[static_cast<std::size_t>(i)];
    gradients.row(i) = row.gradient.transpose();
    least[i] = row.least;
  }
  std::vector<Index> joined, apart(programme.rows.size());
  std::iota(apart.begin(), apart.end(), 0);
  while (true) {
    auto found = optimum_of(programme, joined);
    if (!found) return found;
    const VectorXd lack = least - gradients * found->x;
    const auto satisfied =
        std::partition(apart.begin(), apart.end(), [&](Index i) { return lack[i] > tolerance; });
    if (satisfied == apart.begin()) return found;
    const auto end = apart.begin() + std::min(at_a_time, satisfied - apart.begin());
    std::nth_element(apart.begin(), end, satisfied,
                     [&](Index i, Index j) { return lack[i] > lack[j]; });
    joined.insert(joined.end(), apart.begin(), end);
    apart.erase(apart.begin(), end);
  }
}

}  // namespace tachless::numerics
