#include "certificate/optimise.h"

#include <nlopt.h>

#include <algorithm>
#include <exception>
#include <memory>

namespace tachless::certificate {
namespace {

struct Search {
  const std::function<double(const Eigen::VectorXd&)>& f;
  Minimum best;
  std::exception_ptr failure;
  nlopt_opt handle = nullptr;
};

// NLopt's handling of infinite values is not documented: a large number says the same.
constexpr double out_of_range = 1e300;

double evaluate(unsigned n, const double* x, double* /*gradient*/, void* data) {
  Search& search = *static_cast<Search*>(data);
  try {
    const Eigen::VectorXd point = Eigen::Map<const Eigen::VectorXd>(x, n);
    const double value = search.f(point);
    if (!(value < out_of_range)) return out_of_range;
    if (value < search.best.value) search.best = {point, value};
    return value;
  } catch (...) {  // must not pass through C code
    search.failure = std::current_exception();
    nlopt_force_stop(search.handle);
    return out_of_range;
  }
}

}  // namespace

Minimum minimise(const std::function<double(const Eigen::VectorXd&)>& f,
                 const Eigen::VectorXd& start, double step, int max_evaluations) {
  const std::unique_ptr<nlopt_opt_s, decltype(&nlopt_destroy)> opt(
      nlopt_create(NLOPT_LN_SBPLX, static_cast<unsigned>(start.size())), &nlopt_destroy);
  Search search{f, {start, out_of_range}, nullptr, opt.get()};
  nlopt_set_min_objective(opt.get(), evaluate, &search);
  nlopt_set_initial_step1(opt.get(), step);
  nlopt_set_maxeval(opt.get(), max_evaluations);
  nlopt_set_xtol_abs1(opt.get(), 1e-5);
  nlopt_set_ftol_rel(opt.get(), 1e-8);
  Eigen::VectorXd x = start;
  double value = 0;
  nlopt_optimize(opt.get(), x.data(), &value);  // its result says why it stopped: all are fine
  if (search.failure) std::rethrow_exception(search.failure);
  return search.best;
}

}  // namespace tachless::certificate
