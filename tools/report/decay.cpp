#include "report/decay.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace tachless::report {
namespace {

struct Sums {
  double n = 0, t = 0, y = 0, tt = 0, ty = 0, yy = 0;

  void add(double t_s, double value) {
    n += 1;
    t += t_s;
    y += value;
    tt += t_s * t_s;
    ty += t_s * value;
    yy += value * value;
  }
  [[nodiscard]] double around_mean() const { return n > 0 ? std::max(0.0, yy - y * y / n) : 0; }
  [[nodiscard]] double around_line() const {
    const double stt = tt - t * t / n;
    const double sty = ty - t * y / n;
    return stt > 0 ? std::max(0.0, around_mean() - sty * sty / stt) : around_mean();
  }
};

/// Returns the upper envelope from the peak on, as points (t, log).
std::vector<study::Point> log_envelope(const std::vector<study::Point>& magnitude) {
  std::vector<study::Point> envelope;
  double upper = 0;
  for (std::size_t i = magnitude.size(); i-- > 0;) {
    if (!std::isfinite(magnitude[i].y)) return {};
    upper = std::max(upper, magnitude[i].y);
    // The envelope is zero after the last nonzero value, and has no logarithm there.
    if (upper > 0) envelope.push_back({magnitude[i].x, std::log(upper)});
  }
  std::reverse(envelope.begin(), envelope.end());
  std::size_t peak = 0;
  while (peak + 1 < envelope.size() && envelope[peak + 1].y == envelope[peak].y) ++peak;
  envelope.erase(envelope.begin(), envelope.begin() + static_cast<std::ptrdiff_t>(peak));
  return envelope;
}

constexpr std::size_t fewest = 6;         // a line has two numbers, so that four points check it
constexpr std::size_t most_points = 300;  // 45,000 slopes between them
// Least fall of the logarithm: by half. Largest scatter about the line, as a share of the fall.
constexpr double least_drop = std::numbers::ln2, most_scatter = 0.2;

/// Returns the number of points of the falling line.
std::size_t length_of_fall(const std::vector<study::Point>& envelope) {
  std::vector<double> rest(envelope.size() + 1);
  Sums after;
  for (std::size_t i = envelope.size(); i-- > 0;) {
    after.add(envelope[i].x - envelope.front().x, envelope[i].y);
    rest[i] = after.around_mean();
  }
  Sums line;
  std::size_t best = envelope.size();
  double least = INFINITY;
  for (std::size_t i = 0; i < envelope.size(); ++i) {
    line.add(envelope[i].x - envelope.front().x, envelope[i].y);
    const double residual = line.around_line() + rest[i + 1];
    if (i + 1 >= fewest && residual < least) {
      least = residual;
      best = i + 1;
    }
  }
  return best;
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

std::optional<Decay> fit_decay(const std::vector<study::Point>& magnitude) {
  std::vector<study::Point> fall = log_envelope(magnitude);
  if (fall.size() < fewest) return {};
  fall.resize(length_of_fall(fall));

  std::vector<double> slopes;
  const std::size_t stride = std::max<std::size_t>(1, fall.size() / most_points);
  for (std::size_t i = 0; i < fall.size(); i += stride) {
    for (std::size_t j = i + stride; j < fall.size(); j += stride) {
      if (fall[j].x > fall[i].x) {
        slopes.push_back((fall[j].y - fall[i].y) / (fall[j].x - fall[i].x));
      }
    }
  }
  if (slopes.empty()) return {};
  const double slope = median(std::move(slopes));
  std::vector<double> offsets;
  offsets.reserve(fall.size());
  for (const study::Point& point : fall)
    offsets.push_back(point.y - slope * (point.x - fall.front().x));
  const double offset = median(offsets);

  const double drop = -slope * (fall.back().x - fall.front().x);
  double squares = 0;
  for (const double value : offsets) squares += (value - offset) * (value - offset);
  const double rms = std::sqrt(squares / static_cast<double>(fall.size()));
  if (!(drop >= least_drop) || rms > most_scatter * drop) return {};
  return Decay{-slope, std::exp(offset), fall.front().x, fall.back().x};
}

}  // namespace tachless::report
