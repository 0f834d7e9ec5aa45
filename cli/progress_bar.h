#pragma once

#include <chrono>
#include <cstddef>
#include <string>

namespace mapp {

/// A bar on stderr while a person is looking; silent when stderr is not a terminal. One thread only.
class ProgressBar {
 public:
  ProgressBar(std::string label, size_t total);
  ~ProgressBar();  ///< Wipes the bar.
  ProgressBar(const ProgressBar&) = delete;
  ProgressBar& operator=(const ProgressBar&) = delete;

  /// Redraws at most ten times a second. `note` stands behind the bar.
  void Update(size_t done, const std::string& note);

 private:
  std::string label_;
  size_t total_;
  bool visible_;
  std::chrono::steady_clock::time_point next_draw_;
};

}  // namespace mapp
