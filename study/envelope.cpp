#include "study/envelope.h"

namespace tachless::study {

// `a` comes before `b`.
Envelope::Bin Envelope::merge(const Bin& a, const Bin& b) {
  return {a.low.y <= b.low.y ? a.low : b.low, a.high.y >= b.high.y ? a.high : b.high};
}

// An odd one at the end stays as it is.
void Envelope::halve(std::vector<Bin>& bins) {
  for (std::size_t i = 0; i < bins.size() / 2; ++i) bins[i] = merge(bins[2 * i], bins[2 * i + 1]);
  if (bins.size() % 2 != 0) bins[bins.size() / 2] = bins.back();
  bins.resize((bins.size() + 1) / 2);
}

void Envelope::add(double x, double y) {
  const Bin sample{{x, y}, {x, y}};
  if (!bins_.empty() && samples_in_last_ < samples_per_bin_) {
    bins_.back() = merge(bins_.back(), sample);
    ++samples_in_last_;
    return;
  }
  if (bins_.size() == max_points / 2) {
    halve(bins_);
    samples_per_bin_ *= 2;
  }
  bins_.push_back(sample);
  samples_in_last_ = 1;
}

std::vector<Point> Envelope::points(std::size_t at_most) const {
  std::vector<Bin> bins = bins_;
  while (bins.size() > 1 && 2 * bins.size() > at_most) halve(bins);
  std::vector<Point> points;
  points.reserve(2 * bins.size());
  for (const auto& [low, high] : bins) {
    points.push_back(low.x <= high.x ? low : high);
    if (low.x != high.x) points.push_back(low.x <= high.x ? high : low);
  }
  return points;
}

}  // namespace tachless::study
