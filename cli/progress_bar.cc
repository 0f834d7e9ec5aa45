#include "cli/progress_bar.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <unistd.h>

namespace mapp {

ProgressBar::ProgressBar(std::string label, size_t total)
    : label_(std::move(label)), total_(std::max<size_t>(total, 1)), visible_(isatty(STDERR_FILENO) == 1) {}

ProgressBar::~ProgressBar() {
  if (visible_) std::fputs("\r\033[K", stderr);
}

void ProgressBar::Update(size_t done, const std::string& note) {
  const auto now = std::chrono::steady_clock::now();
  if (!visible_ || now < next_draw_) return;
  next_draw_ = now + std::chrono::milliseconds(100);
  constexpr size_t kWidth = 30;
  const size_t filled = kWidth * std::min(done, total_) / total_;
  fmt::print(stderr, "\r\033[K{} [{:#<{}}{:.<{}}] {}/{} {}", label_, "", filled, "", kWidth - filled, done, total_,
             note);
  std::fflush(stderr);
}

}  // namespace mapp
