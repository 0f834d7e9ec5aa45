#include "client_sdk/src/tracker/local_window.h"

#include <algorithm>
#include <map>
#include <unordered_set>

namespace mapp::tracker {
namespace {

/// Keyframes gathered at most, so that a frame costs the same however dense the map is.
constexpr size_t kMaxKeyframes = 24;
constexpr size_t kMaxSharing = 12;   ///< of them those that share points with the frame
constexpr size_t kMaxNeighbors = 3;  ///< taken along per sharing keyframe

/// Keyframes by the number of the frame's points that they observe, most first.
std::vector<std::pair<int, int>> VoteForKeyframes(const SessionMap& map, std::span<const int> frame_points) {
  std::map<int, int> votes;
  for (const int tracked_idx : frame_points) {
    const int point_idx = tracked_idx == kNone ? kNone : map.Resolve(tracked_idx);
    if (point_idx == kNone) continue;
    for (const PointObservation& observation : map.point(point_idx).observations) ++votes[observation.keyframe_idx];
  }
  std::vector<std::pair<int, int>> ranked(votes.begin(), votes.end());
  std::stable_sort(ranked.begin(), ranked.end(), [](const auto& a, const auto& b) { return a.second > b.second; });
  return ranked;
}

class KeyframeSet {
 public:
  void Add(int keyframe_idx) {
    if (keyframes_.size() < kMaxKeyframes && known_.insert(keyframe_idx).second) keyframes_.push_back(keyframe_idx);
  }
  const std::vector<int>& keyframes() const { return keyframes_; }

 private:
  std::vector<int> keyframes_;
  std::unordered_set<int> known_;
};

}  // namespace

LocalWindow GatherLocalWindow(const SessionMap& map, std::span<const int> frame_points, const Pose3& T_session_camera,
                              double metre, int generation) {
  LocalWindow window;
  KeyframeSet gathered;
  std::vector<std::pair<int, int>> sharing = VoteForKeyframes(map, frame_points);
  if (sharing.size() > kMaxSharing) sharing.resize(kMaxSharing);
  if (!sharing.empty()) window.reference_keyframe_idx = sharing.front().first;
  for (const auto& [keyframe_idx, votes] : sharing) gathered.Add(keyframe_idx);
  const std::vector<int> near = map.KeyframesNear(T_session_camera, kNearDistanceM * metre, kNearAngle, generation);
  for (size_t i = 0; i < std::min(near.size(), kMaxKeyframes / 4); ++i) gathered.Add(near[i]);
  for (const auto& [keyframe_idx, votes] : sharing) {
    const auto covisible = map.CovisibleKeyframes(keyframe_idx, kMinSharedPoints);
    for (size_t i = 0; i < std::min(covisible.size(), kMaxNeighbors); ++i) gathered.Add(covisible[i].first);
  }

  std::unordered_set<int> known_points;
  for (const int keyframe_idx : gathered.keyframes()) {
    for (const int point_idx : map.keyframe(keyframe_idx).points) {
      if (point_idx == kNone || !known_points.insert(point_idx).second) continue;
      window.points.push_back(map.point(point_idx).view);
    }
  }
  return window;
}

std::vector<PointView> CopyPoints(const SessionMap& map, std::span<const int> points) {
  std::vector<PointView> copies;
  for (const int tracked_idx : points) {
    const int point_idx = tracked_idx == kNone ? kNone : map.Resolve(tracked_idx);
    if (point_idx != kNone) copies.push_back(map.point(point_idx).view);
  }
  return copies;
}

}  // namespace mapp::tracker
