#include "reference/trajectory/waypoints.h"

#include <algorithm>
#include <ctime>
#include <random>
#include <stdexcept>

#include "reference/trajectory/point_to_point.h"
#include "tests/reference/trajectory/derivatives.h"

namespace tachless::reference::trajectory {
namespace {

/// `num_points` points of a three-joint robot at irregular times.
Waypoints random_points(int num_points, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> gap(0.3, 1.2), angle(-1.5, 1.5);
  Waypoints points;
  double t = 0.25;
  for (int i = 0; i < num_points; ++i) {
    points.time_s.push_back(t);
    points.position_rad.push_back(Vector::NullaryExpr(3, [&] { return angle(random); }));
    t += gap(random);
  }
  return points;
}

TEST(Waypoints, PassesThroughEveryPointAtItsTime) {
  for (const int n : {2, 3, 4, 7, 20}) {
    const Waypoints p = random_points(n, 10 + n);
    const WaypointSpline spline(p);
    for (int i = 0; i < n; ++i) {
      // The values are exact except at the end of a mirrored piece, which is a sum of eight rounded
      // coefficients.
      EXPECT_LE((spline.at(p.time_s[i]).q_ref - p.position_rad[i]).lpNorm<Eigen::Infinity>(),
                i == n - 2 ? 1e-13 : 0)
          << "point " << i << " of " << n;
    }
  }
}

TEST(Waypoints, IsContinuousThroughSnapAtEveryPoint) {
  for (const int n : {2, 3, 4, 7, 20}) {
    const Waypoints p = random_points(n, 20 + n);
    const WaypointSpline spline(p);
    for (int i = 0; i < n; ++i) {
      const double t = p.time_s[i];
      const auto before = orders(spline.at(std::nextafter(t, 0)));
      const auto after = orders(spline.at(std::nextafter(t, 100)));
      for (int k = 0; k < 5; ++k) {
        // Rounding of the coefficients' solve, some 1e4 eps of the largest snap seen (1e3..1e4).
        EXPECT_LE((before[k] - after[k]).lpNorm<Eigen::Infinity>(), 1e-8)
            << "order " << k << " at point " << i << " of " << n;
      }
    }
  }
}

TEST(Waypoints, IsAtRestThroughSnapAtBothEndsAndHoldsOutside) {
  const Waypoints p = random_points(6, 31);
  const WaypointSpline spline(p);
  expect_at_rest(spline.at(std::nextafter(p.time_s.front(), 100)), 1e-9);
  expect_at_rest(spline.at(std::nextafter(p.time_s.back(), 0)), 1e-9);
  EXPECT_EQ(spline.at(0).q_ref, p.position_rad.front());
  EXPECT_EQ(spline.at(p.time_s.back() + 5).q_ref, p.position_rad.back());
  expect_at_rest(spline.at(0), 0);
  expect_at_rest(spline.at(p.time_s.back()), 0);
}

TEST(Waypoints, EachDerivativeIsThatOfTheOneBefore) {
  const Waypoints p = random_points(6, 41);
  const WaypointSpline spline(p);
  for (std::size_t i = 0; i + 1 < p.time_s.size(); ++i) {
    const double duration = p.time_s[i + 1] - p.time_s[i];
    for (const double x : {0.05, 0.3, 0.5, 0.8, 0.95}) {
      // Pieces are of degree 7 at most, so the formula has no error of its own.
      expect_derivatives_of_each_other(spline, p.time_s[i] + x * duration, 0.01 * duration,
                                       {0, 0, 0, 0});
    }
  }
}

TEST(Waypoints, WithTwoPointsIsPointToPoint) {
  const Waypoints p = random_points(2, 51);
  const WaypointSpline spline(p);
  const PointToPoint polynomial{p.position_rad[0], p.position_rad[1], p.time_s[0],
                                p.time_s[1] - p.time_s[0]};
  for (int i = 0; i <= 10; ++i) {
    const double t = p.time_s[0] + 0.1 * i * polynomial.duration_s;
    const auto one = orders(spline.at(t));
    const auto other = orders(polynomial.at(t));
    for (int k = 0; k < 5; ++k) {
      // Power form against factored form: cancellation among terms of up to 4e5 / T^4 (snap).
      EXPECT_LE((one[k] - other[k]).lpNorm<Eigen::Infinity>(),
                4e6 * std::numeric_limits<double>::epsilon() / std::pow(polynomial.duration_s, 4))
          << "order " << k;
    }
  }
}

TEST(Waypoints, DoesNotDependOnTheUnitOfTime) {
  const Waypoints p = random_points(5, 61);
  std::vector<double> milli = p.time_s;
  for (double& t : milli) {
    t *= 1e-3;
  }
  const WaypointSpline slow(p), fast(Waypoints{milli, p.position_rad});
  for (const double t : {0.4, 1.1, 2.0}) {
    EXPECT_LE((slow.at(t).q_ref - fast.at(1e-3 * t).q_ref).lpNorm<Eigen::Infinity>(), 1e-12);
    // One more factor 1000 per derivative; solve and rounding of the times remain.
    EXPECT_LE((slow.at(t).snap_ref - 1e-12 * fast.at(1e-3 * t).snap_ref).lpNorm<Eigen::Infinity>(),
              1e-8);
  }
}

TEST(Waypoints, AreSolvedInTimeInProportionToTheirNumber) {
  const auto time = [](int num_points) {
    const Waypoints points = random_points(num_points, 71);
    double least = 1e9;
    for (int repeat = 0; repeat < 3; ++repeat) {
      const std::clock_t start = std::clock();
      const WaypointSpline spline(points);
      least = std::min(least, double(std::clock() - start) / CLOCKS_PER_SEC);
    }
    return least;
  };
  // Linear cost gives 4, and three times that if the memory exceeds the caches; a dense solution
  // takes 64.
  EXPECT_LT(time(2000) / time(500), 16);
}

TEST(Waypoints, RefuseWhatMakesNoSplineAndNameIt) {
  const Vector zero = Vector::Zero(2);
  const auto refused = [](const Waypoints& points) {
    EXPECT_THROW(WaypointSpline{points}, std::invalid_argument);
    const auto refusal = points.refusal();
    return refusal ? refusal->key + ": " + refusal->problem : "accepted";
  };
  EXPECT_EQ(refused({{0, 2, 2}, {zero, zero, zero}}),
            "time_s: time 3 (2 s) is not after time 2 (2 s); allowed: strictly increasing times");
  EXPECT_EQ(refused({{0}, {zero}}), "time_s: 1 times; allowed: at least 2");
  EXPECT_EQ(refused({{0, 1}, {zero}}), "position_rad: 1 positions; allowed: 2, one per time");
  EXPECT_EQ(refused({{0, 1}, {zero, Vector::Zero(3)}}),
            "position_rad: a position with 3 entries, the first has 2; allowed: one per joint");
}

}  // namespace
}  // namespace tachless::reference::trajectory
