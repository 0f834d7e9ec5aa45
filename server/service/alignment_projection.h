#pragma once

#include "server/service/frame_view.h"
#include "server/service/own_frames.h"
#include "server/service/view_agreement.h"
#include "vision/matching.h"

#include <Eigen/Core>

#include <optional>
#include <span>
#include <vector>

namespace mapp {

/// Feature of a keyframe and the map point it was found to see.
struct AlignmentMatch {
  int feature_idx = 0;
  MapPointId point;
};

/// A keyframe made ready for comparison with map points. Borrows the view, which must outlive it.
class QueryKeyframe {
 public:
  explicit QueryKeyframe(const FrameView& view);
  /// The same keyframe, its depths of DepthKind::kUnscaled taken as so many of the map's units each.
  QueryKeyframe AtScale(double scale) const;

  const FrameView& view() const { return *view_; }
  const std::vector<Feature>& features() const { return features_; }
  /// By undistorted pixel.
  const FeatureGrid& grid() const { return grid_; }
  double scale() const { return scale_; }
  /// Depth along the optical axis that the device sent with the feature, in the map's unit; 0 = none.
  double depth_m(int feature_idx) const;
  /// Greatest distance between an own point at this depth and the map point it matches: PointTolerance() for measured
  /// depths, and more for what was triangulated over a short way or compares with such.
  double tolerance_m(double depth_m) const;
  /// The feature's point in the camera's frame; nullopt without depth.
  std::optional<Eigen::Vector3d> PointInCamera(int feature_idx) const;

 private:
  const FrameView* view_;
  std::vector<Feature> features_;
  FeatureGrid grid_;
  double scale_ = 1;
};

/// Greatest distance between a keyframe's own point and the map point it matches, metres: the depth noise of RGB-D and
/// stereo cameras plus that of the point itself grows with depth.
double PointTolerance(double depth_m);

/// A camera pose supported by map points.
struct ProjectionAlignment {
  Pose3 T_map_camera;
  /// Length of the keyframe's unit in the map: 1 unless its depths are kUnscaled.
  double scale = 1;
  /// Of the pose, [rho; phi] right perturbation (vision/pose_optimizer.h).
  Eigen::Matrix<double, 6, 6> information = Eigen::Matrix<double, 6, 6>::Zero();
  std::vector<AlignmentMatch> inliers;
  int num_offered = 0;  ///< matches that the inliers were chosen from
  int num_cells = 0;    ///< of a 4x4 grid over the image, those that hold inliers
  ViewAgreement agreement;
};

/// Refines a rough T_map_camera by guided matching: projects `points`, matches them within 12 and then 6 pixels (at
/// octave 0), optimises the pose after each round and keeps what agrees in pixel and in depth. Only depths that were
/// measured weigh in the pose; unscaled ones give a new scale after each round, begun at the query's. nullopt when the
/// matches do not hold a pose, or the depths no scale: a normal outcome.
std::optional<ProjectionAlignment> AlignByProjection(const QueryKeyframe& query, std::span<const PointRecord> points,
                                                     const Pose3& T_map_camera);

/// Length of the keyframe's unit of depth in the map, by the points that it was matched with, seen from `T_map_camera`;
/// nullopt when they do not agree on one.
std::optional<double> ScaleFromDepths(const QueryKeyframe& query, std::span<const int> feature_idxs,
                                      std::span<const Eigen::Vector3d> p_map, const Pose3& T_map_camera);

/// What the camera should see again: points of the map met at about this angle before, whose descriptors should still
/// be alike; those behind something nearer included.
std::vector<ExpectedPoint> ExpectedPoints(const QueryKeyframe& query, std::span<const PointRecord> points,
                                          const Pose3& T_map_camera);

/// Live map points seen by frames of the map that look at about the same place as a camera at `T_map_camera`: the
/// nearest such frames other than `besides`, a bounded number of them.
StatusOr<std::vector<PointRecord>> PointsSeenNear(MapReader& reader, MapId map, const OwnFrames& besides,
                                                  const Pose3& T_map_camera);

}  // namespace mapp
