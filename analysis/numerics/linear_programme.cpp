#include "numerics/linear_programme.h"

#include <coin/Clp_C_Interface.h>

#include <limits>
#include <memory>

namespace tachless::numerics {

using Eigen::Index;

std::optional<Optimum> solution(const LinearProgramme& programme) {
  const Index columns = programme.cost.size(), rows = std::ssize(programme.rows);
  std::vector<CoinBigIndex> start;
  std::vector<int> row_of;
  std::vector<double> value, least, none(programme.rows.size(), std::numeric_limits<double>::max());
  for (const auto& row : programme.rows) least.push_back(row.least);
  for (Index j = 0; j < columns; ++j) {
    start.push_back(static_cast<CoinBigIndex>(value.size()));
    for (Index i = 0; i < rows; ++i) {
      const double entry = programme.rows[static_cast<std::size_t>(i)].gradient[j];
      if (entry == 0) continue;
      row_of.push_back(static_cast<int>(i));
      value.push_back(entry);
    }
  }
  start.push_back(static_cast<CoinBigIndex>(value.size()));
  const std::unique_ptr<Clp_Simplex, decltype(&Clp_deleteModel)> model(Clp_newModel(),
                                                                       &Clp_deleteModel);
  Clp_setLogLevel(model.get(), 0);
  Clp_loadProblem(model.get(), static_cast<int>(columns), static_cast<int>(rows), start.data(),
                  row_of.data(), value.data(), programme.lower.data(), programme.upper.data(),
                  programme.cost.data(), least.data(), none.data());
  Clp_dual(model.get(), 0);
  if (Clp_status(model.get()) != 0) return {};
  return Optimum{Eigen::Map<const Eigen::VectorXd>(Clp_primalColumnSolution(model.get()), columns),
                 Eigen::Map<const Eigen::VectorXd>(Clp_dualRowSolution(model.get()), rows)};
}

}  // namespace tachless::numerics
