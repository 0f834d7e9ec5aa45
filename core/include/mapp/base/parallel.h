#pragma once

#include <atomic>
#include <thread>
#include <vector>

namespace mapp {

/// Calls work(0) ... work(count - 1), shared out among `num_threads` threads, of which the caller is one; returns when
/// all are done. `work` must not throw.
template <typename Work>
void ParallelFor(int num_threads, int count, const Work& work) {
  std::atomic<int> next{0};
  const auto run = [&] {
    for (int i = next.fetch_add(1); i < count; i = next.fetch_add(1)) work(i);
  };
  std::vector<std::jthread> helpers;
  for (int i = 1; i < num_threads; ++i) helpers.emplace_back(run);
  run();
}

}  // namespace mapp
