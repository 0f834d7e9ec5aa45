#include "client_sdk/src/tracker/restart_policy.h"

#include <algorithm>

namespace mapp::tracker {
namespace {

/// What one frame may count for: a camera that delivers rarely, or an app that was away for a minute, has tried its map
/// once all the same.
constexpr int64_t kMaxStepNs = 500'000'000;

}  // namespace

bool RestartPolicy::IsDue(const Outcome& outcome) {
  const int64_t step_ns = last_stamp_ns_ ? outcome.stamp_ns - *last_stamp_ns_ : 0;
  last_stamp_ns_ = outcome.stamp_ns;
  if (!outcome.lost) {
    searched_ns_ = 0;
    return false;
  }
  if (!outcome.can_start || options_.max_search_s == 0) return false;
  searched_ns_ += std::min(step_ns, kMaxStepNs);
  const bool young = outcome.num_keyframes < options_.num_young_keyframes;
  const double max_search_s =
      young ? std::min(options_.max_young_search_s, options_.max_search_s) : options_.max_search_s;
  return searched_ns_ >= static_cast<int64_t>(1e9 * max_search_s);
}

}  // namespace mapp::tracker
