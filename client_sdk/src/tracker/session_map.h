#pragma once

#include "client_sdk/src/tracker/frame.h"
#include "mapp/base/id.h"
#include "mapp/base/mutex.h"
#include "mapp/feature/feature.h"
#include "mapp/geometry/pose3.h"

#include <Eigen/Core>

#include <cstdint>
#include <memory>
#include <numbers>
#include <optional>
#include <span>
#include <utility>
#include <vector>

namespace mapp::tracker {

/// Index of a feature's map point, or of a keyframe, where there is none.
inline constexpr int kNone = -1;

/// Keyframes are neighbors when they share this many points; an edge of the covisibility graph (Mur-Artal 2015).
inline constexpr int kMinSharedPoints = 15;
/// Keyframes that see about the same, as they stand near and look the same way.
inline constexpr double kNearDistanceM = 1.0;  ///< or what stands for a metre
inline constexpr double kNearAngle = 35.0 * std::numbers::pi / 180.0;

/// A copy of what it takes to find a map point in an image: matching works on copies, without the map's lock.
struct PointView {
  int point_idx = kNone;
  Eigen::Vector3d p_session = Eigen::Vector3d::Zero();
  Eigen::Vector3f view_direction = Eigen::Vector3f::UnitZ();  ///< unit, mean of (point - observing camera)
  float reference_distance_m = 1;                             ///< detected at octave o from reference / 1.2^o
  OrbDescriptor descriptor;
  bool from_server = false;  ///< came with a shared map
};

struct PointObservation {
  int keyframe_idx = kNone;
  int feature_idx = kNone;
};

struct MapPoint {
  PointView view;
  std::vector<PointObservation> observations;
  uint64_t session_id = 0;              ///< the device's own name for the point; never used twice
  std::optional<MapPointId> server_id;  ///< of a point that came with a shared map: it never moves and is never culled
  int generation = 0;
  int first_keyframe_idx = kNone;  ///< the keyframe that made it
  int num_visible = 0;             ///< frames in whose image it should have appeared
  int num_found = 0;               ///< frames in which it was an inlier
  bool removed = false;
  int replaced_by = kNone;  ///< after a fusion, the point that took its place
};

struct MapKeyframe {
  std::shared_ptr<const Frame> frame;  ///< null once its generation is retired: only the pose is left
  Pose3 T_session_camera;
  std::vector<int> points;  ///< per feature; kNone or a point that is not removed
  int generation = 0;
};

/// The keyframes and map points of the session, as tracking and local mapping share them. Indices are stable.
///
/// A *generation* is the part of the map that is consistent with itself: taking over a shared map begins a new one,
/// since the device's own points may be off from the server's by the alignment's error. Points and keyframes of
/// different generations never meet; a retired generation keeps its keyframes' poses and nothing else.
///
/// Thread-compatible: guard it with the mutex of SharedSessionMap.
class SessionMap {
 public:
  // --- building
  /// Adds a keyframe that observes `points` (one entry per feature; kNone for none). Returns its index.
  int AddKeyframe(std::shared_ptr<const Frame> frame, const Pose3& T_session_camera, const std::vector<int>& points,
                  int generation);
  /// Adds a point first seen by a feature of a keyframe, which does not have a point yet. Returns its index.
  int AddPoint(const Eigen::Vector3d& p_session, int keyframe_idx, int feature_idx);
  /// Adds a point of a shared map, without observations. `view.point_idx` is ignored. Returns its index.
  int AddSharedPoint(PointView view, MapPointId server_id, int generation);
  /// Adds an observation unless the keyframe already observes the point or the feature has another one.
  bool AddObservation(int point_idx, int keyframe_idx, int feature_idx);
  /// Removes an observation; a point of the session without any observation left is removed.
  void RemoveObservation(int point_idx, int keyframe_idx);
  void RemovePoint(int point_idx);
  /// Moves the observations of `drop_idx` to `keep_idx`, which takes its place from now on.
  void ReplacePoint(int drop_idx, int keep_idx);
  /// Recomputes representative descriptor, view direction and reference distance from the observations. Points of a
  /// shared map keep what the server says.
  void UpdateView(int point_idx);
  /// Frees the points and frames of a generation; its keyframes keep their poses.
  void RetireGeneration(int generation);
  /// Hands out `count` names for points that are not in the map; the first is returned, the others follow it.
  uint64_t ReserveSessionIds(size_t count);

  // --- reading
  /// The point that stands for `point_idx` now: itself, the one it was fused into, or kNone.
  int Resolve(int point_idx) const;
  const MapPoint& point(int point_idx) const { return points_[static_cast<size_t>(point_idx)]; }
  MapPoint& mutable_point(int point_idx) { return points_[static_cast<size_t>(point_idx)]; }
  const MapKeyframe& keyframe(int keyframe_idx) const { return keyframes_[static_cast<size_t>(keyframe_idx)]; }
  void SetKeyframePose(int keyframe_idx, const Pose3& T_session_camera);
  void SetPointPosition(int point_idx, const Eigen::Vector3d& p_session);
  /// Median depth of points in a camera's frame; 1 where there are none. `points` may hold kNone and fused ones.
  double MedianDepth(std::span<const int> points, const Pose3& T_session_camera) const;
  double MedianDepth(int keyframe_idx) const;
  int num_keyframes() const { return static_cast<int>(keyframes_.size()); }
  size_t num_point_slots() const { return points_.size(); }
  /// Keyframes sharing at least `min_shared` points with this one, most first.
  std::vector<std::pair<int, int>> CovisibleKeyframes(int keyframe_idx, int min_shared) const;
  /// Keyframes of a generation within `max_distance_m` and `max_angle` (radians) of a pose, nearest first.
  std::vector<int> KeyframesNear(const Pose3& T_session_camera, double max_distance_m, double max_angle,
                                 int generation) const;

 private:
  int NewPointSlot();

  std::vector<MapKeyframe> keyframes_;
  std::vector<MapPoint> points_;
  std::vector<int> free_slots_;  ///< of retired generations
  uint64_t next_session_id_ = 0;
};

/// The map and its lock. Sections are short: whoever needs long takes copies.
struct SharedSessionMap {
  mutable Mutex mutex;
  SessionMap map ABSL_GUARDED_BY(mutex);
};

}  // namespace mapp::tracker
