#include "client_sdk/src/tracker/local_bundle.h"

#include "vision/bundle_adjustment.h"

#include <algorithm>
#include <map>
#include <unordered_map>
#include <utility>
#include <vector>

namespace mapp::tracker {
namespace {

/// A bundle problem and which keyframes and points of the map it was copied from.
struct Window {
  BundleProblem problem;
  std::vector<int> keyframes;  ///< per frame of the problem
  std::vector<int> points;     ///< per point of the problem
};

class WindowBuilder {
 public:
  WindowBuilder(const SessionMap& map, const TrackingCamera& camera, const LocalBundleOptions& options)
      : map_(map), camera_(camera), options_(options) {}

  Window Build(int keyframe_idx) {
    AddFrame(keyframe_idx, /*fixed=*/false);
    for (const auto& [other_idx, num_shared] : map_.CovisibleKeyframes(keyframe_idx, kMinSharedPoints)) {
      if (static_cast<int>(window_.keyframes.size()) >= options_.window) break;
      AddFrame(other_idx, /*fixed=*/false);
    }
    AddPoints();
    AddFixedObservers();
    FixGauge();
    AddObservations();
    return std::move(window_);
  }

 private:
  void AddFrame(int keyframe_idx, bool fixed) {
    frame_slots_.emplace(keyframe_idx, static_cast<int>(window_.keyframes.size()));
    window_.keyframes.push_back(keyframe_idx);
    window_.problem.frames.push_back(
        {camera_.pinhole, map_.keyframe(keyframe_idx).T_session_camera, fixed, camera_.own_map.bf_px_m});
  }

  void AddPoints() {
    std::unordered_map<int, bool> known;
    for (const int keyframe_idx : window_.keyframes) {
      for (const int point_idx : map_.keyframe(keyframe_idx).points) {
        if (point_idx == kNone || !known.emplace(point_idx, true).second) continue;
        const MapPoint& point = map_.point(point_idx);
        // A point seen once says nothing about the poses.
        if (point.observations.size() < 2 && !point.server_id) continue;
        window_.points.push_back(point_idx);
        window_.problem.points.push_back({point.view.p_session, point.server_id.has_value()});
      }
    }
  }

  void AddFixedObservers() {
    std::map<int, int> num_shared;
    for (const int point_idx : window_.points) {
      for (const PointObservation& observation : map_.point(point_idx).observations) {
        if (!frame_slots_.contains(observation.keyframe_idx)) ++num_shared[observation.keyframe_idx];
      }
    }
    std::vector<std::pair<int, int>> ranked(num_shared.begin(), num_shared.end());
    std::stable_sort(ranked.begin(), ranked.end(), [](const auto& a, const auto& b) { return a.second > b.second; });
    if (ranked.size() > static_cast<size_t>(options_.max_fixed)) ranked.resize(static_cast<size_t>(options_.max_fixed));
    for (const auto& [keyframe_idx, count] : ranked) AddFrame(keyframe_idx, /*fixed=*/true);
  }

  /// The session's frame begins at the first keyframe: it, or else the oldest of the window, holds the gauge.
  void FixGauge() {
    const auto oldest = std::min_element(window_.keyframes.begin(), window_.keyframes.end());
    const bool has_fixed = std::any_of(window_.problem.frames.begin(), window_.problem.frames.end(),
                                       [](const BundleProblem::Frame& frame) { return frame.fixed; });
    if (has_fixed && *oldest != 0) return;
    window_.problem.frames[static_cast<size_t>(oldest - window_.keyframes.begin())].fixed = true;
  }

  void AddObservations() {
    for (size_t point_slot = 0; point_slot < window_.points.size(); ++point_slot) {
      const MapPoint& point = map_.point(window_.points[point_slot]);
      for (const PointObservation& seen : point.observations) {
        const auto frame_slot = frame_slots_.find(seen.keyframe_idx);
        if (frame_slot == frame_slots_.end()) continue;
        const Frame& frame = *map_.keyframe(seen.keyframe_idx).frame;
        const auto feature = static_cast<size_t>(seen.feature_idx);
        BundleProblem::Observation observation;
        observation.frame_idx = frame_slot->second;
        observation.point_idx = static_cast<int>(point_slot);
        observation.pixel = frame.pixels[feature];
        observation.sigma_px = static_cast<double>(OctaveScale(frame.features[feature].keypoint.octave));
        if (!point.server_id || camera_.own_map.applies_to_server_points) {
          observation.depth_m = static_cast<double>(frame.depths_m[feature]);
        }
        window_.problem.observations.push_back(observation);
      }
    }
  }

  const SessionMap& map_;
  const TrackingCamera& camera_;
  const LocalBundleOptions& options_;
  Window window_;
  std::unordered_map<int, int> frame_slots_;  ///< keyframe_idx to index in the problem
};

/// Writes the poses. Points that only one keyframe observes were not adjusted: they follow it.
void WritePoses(const Window& window, SessionMap& map) {
  for (size_t slot = 0; slot < window.keyframes.size(); ++slot) {
    if (window.problem.frames[slot].fixed) continue;
    const int keyframe_idx = window.keyframes[slot];
    const Pose3& T_session_camera = window.problem.frames[slot].T_world_camera;
    const Pose3 T_after_before = T_session_camera * map.keyframe(keyframe_idx).T_session_camera.Inverse();
    map.SetKeyframePose(keyframe_idx, T_session_camera);
    for (const int point_idx : map.keyframe(keyframe_idx).points) {
      if (point_idx == kNone) continue;
      const MapPoint& point = map.point(point_idx);
      if (point.server_id || point.observations.size() != 1) continue;
      map.SetPointPosition(point_idx, T_after_before * point.view.p_session);
      map.UpdateView(point_idx);
    }
  }
}

void WritePoints(const Window& window, const BundleResult& result, SessionMap& map) {
  const BundleProblem& problem = window.problem;
  for (size_t slot = 0; slot < window.points.size(); ++slot) {
    if (!problem.points[slot].fixed) map.SetPointPosition(window.points[slot], problem.points[slot].p_world);
  }
  for (size_t i = 0; i < problem.observations.size(); ++i) {
    if (!result.outliers[i]) continue;
    map.RemoveObservation(window.points[static_cast<size_t>(problem.observations[i].point_idx)],
                          window.keyframes[static_cast<size_t>(problem.observations[i].frame_idx)]);
  }
  for (const int point_idx : window.points) {
    if (!map.point(point_idx).removed) map.UpdateView(point_idx);
  }
}

}  // namespace

Status AdjustLocalWindow(SharedSessionMap& shared, const TrackingCamera& camera, int keyframe_idx,
                         const LocalBundleOptions& options) {
  Window window;
  {
    MutexLock lock(shared.mutex);
    window = WindowBuilder(shared.map, camera, options).Build(keyframe_idx);
  }
  const bool has_free = std::any_of(window.problem.frames.begin(), window.problem.frames.end(),
                                    [](const BundleProblem::Frame& frame) { return !frame.fixed; });
  if (!has_free || window.problem.observations.empty()) return absl::OkStatus();
  BundleOptions bundle_options;
  bundle_options.max_iterations = options.max_iterations;
  bundle_options.is_cancelled = options.is_cancelled;
  MAPP_ASSIGN_OR_RETURN(const BundleResult result, AdjustBundle(window.problem, bundle_options));

  MutexLock lock(shared.mutex);
  WritePoses(window, shared.map);
  WritePoints(window, result, shared.map);
  return absl::OkStatus();
}

}  // namespace mapp::tracker
