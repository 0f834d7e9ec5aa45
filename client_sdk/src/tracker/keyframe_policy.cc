#include "client_sdk/src/tracker/keyframe_policy.h"

#include <algorithm>

namespace mapp::tracker {
namespace {

/// Nearer in time, keyframes see almost the same.
constexpr int kMinFramesBetween = 2;
/// With fewer close points the pose's scale and translation become weak while more are on offer (Mur-Artal and Tardos
/// 2017, section III-E: 100 and 70).
constexpr int kMinCloseMatched = 100;
constexpr int kMinCloseUnmatched = 70;

}  // namespace

bool KeyframePolicy::IsDue(const Observation& frame) {
  ++frames_since_keyframe_;
  most_matches_ = std::max(most_matches_, frame.num_matches);
  if (forced_) return true;
  if (frames_since_keyframe_ >= options_.max_frames_between_keyframes) return true;
  if (frames_since_keyframe_ < kMinFramesBetween) return false;
  if (frame.num_close_matched < kMinCloseMatched && frame.num_close_unmatched > kMinCloseUnmatched) return true;
  return frame.num_matches < options_.min_reference_ratio * most_matches_;
}

void KeyframePolicy::OnKeyframe(const Observation& frame) {
  frames_since_keyframe_ = 0;
  most_matches_ = frame.num_matches;
  forced_ = false;
}

}  // namespace mapp::tracker
