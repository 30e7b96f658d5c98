#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <exception>
#include <mutex>
#include <thread>
#include <type_traits>
#include <vector>

namespace tachless::base {

/// Returns the number of cores, at least 1. The system is asked once: each question reads a file.
inline unsigned all_cores() {
  static const unsigned cores = std::max(1U, std::thread::hardware_concurrency());
  return cores;
}

/// Calls f(0) … f(count - 1) on all cores, in no particular order, and returns when all are done.
/// Rethrows the first exception of f.
template <class F>
void parallel_for(std::size_t count, const F& f, unsigned most_threads = all_cores()) {
  const std::size_t num_threads = std::min<std::size_t>(count, most_threads);
  if (num_threads <= 1) {
    for (std::size_t i = 0; i < count; ++i) f(i);
    return;
  }
  std::atomic<std::size_t> next = 0;
  std::exception_ptr failure;
  std::mutex failure_mutex;
  const auto work = [&] {
    for (std::size_t i = next++; i < count; i = next++) {
      try {
        f(i);
      } catch (...) {
        const std::lock_guard lock(failure_mutex);
        if (!failure) failure = std::current_exception();
        next = count;
      }
    }
  };
  std::vector<std::jthread> threads;
  for (std::size_t t = 1; t < num_threads; ++t) threads.emplace_back(work);
  work();
  threads.clear();
  if (failure) std::rethrow_exception(failure);
}

/// Returns f(0) … f(count - 1), computed by parallel_for.
template <class F>
auto parallel_map(std::size_t count, const F& f) {
  using Result = std::invoke_result_t<F, std::size_t>;
  static_assert(!std::is_same_v<Result, bool>, "threads would write bits of one word");
  std::vector<Result> result(count);
  parallel_for(count, [&](std::size_t i) { result[i] = f(i); });
  return result;
}

}  // namespace tachless::base
