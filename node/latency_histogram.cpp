#include "node/latency_histogram.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace tachless::node {

// Below 16 ns one bucket a nanosecond; above, the four bits after the leading one.
int LatencyHistogram::bucket_of(std::int64_t ns) {
  const auto value = static_cast<std::uint64_t>(std::max<std::int64_t>(ns, 0));
  if (value < per_octave) return static_cast<int>(value);
  const int exponent = std::bit_width(value) - 5;
  const int bucket = (exponent + 1) * per_octave + static_cast<int>((value >> exponent) & 15);
  return std::min(bucket, num_buckets - 1);
}

std::int64_t LatencyHistogram::lower_edge(int bucket) {
  if (bucket < per_octave) return bucket;
  const int exponent = bucket / per_octave - 1;
  return std::int64_t{per_octave + bucket % per_octave} << exponent;
}

void LatencyHistogram::add(std::chrono::nanoseconds duration) {
  ++counts_[static_cast<std::size_t>(bucket_of(duration.count()))];
  ++count_;
  max_ns_ = std::max<std::int64_t>(max_ns_, duration.count());
}

void LatencyHistogram::add(const Bucket& bucket) {
  counts_[static_cast<std::size_t>(bucket_of(std::llround(bucket.from_us * 1e3)))] += bucket.count;
  count_ += bucket.count;
}

void LatencyHistogram::raise_max(double max_us) {
  max_ns_ = std::max<std::int64_t>(max_ns_, std::llround(max_us * 1e3));
}

double LatencyHistogram::max_us() const { return static_cast<double>(max_ns_) * 1e-3; }

double LatencyHistogram::percentile_us(double part) const {
  if (count_ == 0) return 0;
  const auto wanted =
      std::max<std::int64_t>(1, std::llround(std::ceil(part * static_cast<double>(count_))));
  std::int64_t seen = 0;
  for (int bucket = 0; bucket < num_buckets; ++bucket) {
    seen += counts_[static_cast<std::size_t>(bucket)];
    if (seen >= wanted) {
      const std::int64_t upper = lower_edge(bucket + 1) - 1;
      return static_cast<double>(std::min(upper, max_ns_)) * 1e-3;
    }
  }
  return max_us();
}

std::vector<LatencyHistogram::Bucket> LatencyHistogram::buckets() const {
  std::vector<Bucket> result;
  for (int bucket = 0; bucket < num_buckets; ++bucket) {
    const std::int64_t count = counts_[static_cast<std::size_t>(bucket)];
    if (count > 0) result.push_back({static_cast<double>(lower_edge(bucket)) * 1e-3, count});
  }
  return result;
}

}  // namespace tachless::node
