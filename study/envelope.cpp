#include "study/envelope.h"

namespace tachless::study {

// `a` comes before `b`.
Envelope::Bin Envelope::merge(const Bin& a, const Bin& b) {
  Bin merged;
  const bool low_from_a = a.low.y <= b.low.y;
  const bool high_from_a = a.high.y >= b.high.y;
  merged.low = low_from_a ? a.low : b.low;
  merged.high = high_from_a ? a.high : b.high;
  if (low_from_a != high_from_a) {
    merged.low_first = low_from_a;
  } else {
    merged.low_first = low_from_a ? a.low_first : b.low_first;
  }
  return merged;
}

// An odd one at the end stays as it is.
void Envelope::halve(std::vector<Bin>& bins) {
  for (std::size_t i = 0; i < bins.size() / 2; ++i) bins[i] = merge(bins[2 * i], bins[2 * i + 1]);
  if (bins.size() % 2 != 0) bins[bins.size() / 2] = bins.back();
  bins.resize((bins.size() + 1) / 2);
}

void Envelope::add(double x, double y) {
  const Bin sample{{x, y}, {x, y}, true};
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

std::vector<Point> Envelope::points() const { return points_of(bins_); }

std::vector<Point> Envelope::points(std::size_t at_most) const {
  std::vector<Bin> bins = bins_;
  while (bins.size() > 1 && 2 * bins.size() > at_most) halve(bins);
  return points_of(bins);
}

std::vector<Point> Envelope::points_of(const std::vector<Bin>& bins) {
  std::vector<Point> points;
  points.reserve(2 * bins.size());
  for (const Bin& bin : bins) {
    const Point& first = bin.low_first ? bin.low : bin.high;
    const Point& second = bin.low_first ? bin.high : bin.low;
    points.push_back(first);
    if (second.x != first.x) points.push_back(second);
  }
  return points;
}

}  // namespace tachless::study
