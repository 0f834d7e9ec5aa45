#include "client_sdk/src/tracker/keyframe_policy.h"

#include "client_sdk/src/tracker/depth_points.h"
#include "client_sdk/src/tracker/local_window.h"
#include "client_sdk/src/tracker/point_search.h"

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

bool KeyframePolicy::IsDue(const TrackedFrame& tracked, bool on_shared_map) {
  ++frames_since_keyframe_;
  const int num_matches = CountReferenceMatches(tracked);
  most_matches_ = std::max(most_matches_, num_matches);
  if (forced_) return true;
  const bool starting = num_keyframes_ < options_.num_start_keyframes;
  if (frames_since_keyframe_ >=
      (starting ? options_.max_frames_between_start_keyframes : options_.max_frames_between_keyframes)) {
    return true;
  }
  if (frames_since_keyframe_ < kMinFramesBetween) return false;
  // A server's map holds fewer of a frame's close points than the device's own map does after a keyframe: to weigh them
  // there would call for one at every other frame.
  if (!on_shared_map && LacksClosePoints(tracked)) return true;
  return num_matches < options_.min_reference_ratio * most_matches_;
}

void KeyframePolicy::OnKeyframe(const TrackedFrame& tracked) {
  SetReference(tracked);
  ++num_keyframes_;
  frames_since_keyframe_ = 0;
  forced_ = false;
}

void KeyframePolicy::SetReference(const TrackedFrame& tracked) {
  most_matches_ = 0;
  if (camera_.metric()) {
    reference_points_ = DepthPointViews(*tracked.frame, camera_, tracked.T_session_camera, {});
    return;
  }
  MutexLock lock(shared_.mutex);
  reference_points_ = CopyPoints(shared_.map, tracked.points);
}

int KeyframePolicy::CountReferenceMatches(const TrackedFrame& tracked) const {
  SearchOptions options;
  options.max_distance = 64;
  const SearchResult found =
      SearchByProjection(*tracked.frame, camera_, tracked.T_session_camera, reference_points_, options);
  return static_cast<int>(found.matches.size());
}

bool KeyframePolicy::LacksClosePoints(const TrackedFrame& tracked) const {
  int num_matched = 0, num_unmatched = 0;
  for (size_t feature = 0; feature < tracked.points.size(); ++feature) {
    if (!HasUsableDepth(*tracked.frame, feature, camera_)) continue;
    ++(tracked.points[feature] != kNone ? num_matched : num_unmatched);
  }
  return num_matched < kMinCloseMatched && num_unmatched > kMinCloseUnmatched;
}

}  // namespace mapp::tracker
