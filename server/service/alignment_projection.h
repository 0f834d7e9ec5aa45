#pragma once

#include "server/service/frame_view.h"
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

  const FrameView& view() const { return *view_; }
  const std::vector<Feature>& features() const { return features_; }
  /// By undistorted pixel.
  const FeatureGrid& grid() const { return grid_; }
  /// Depth along the optical axis that the device sent with the feature, metres; 0 = none.
  double depth_m(int feature_idx) const;
  /// The feature's point in the camera's frame; nullopt without depth.
  std::optional<Eigen::Vector3d> PointInCamera(int feature_idx) const;

 private:
  const FrameView* view_;
  std::vector<Feature> features_;
  FeatureGrid grid_;
};

/// Greatest distance between a keyframe's own point and the map point it matches, metres: the depth noise of RGB-D and
/// stereo cameras plus that of the point itself grows with depth.
double PointTolerance(double depth_m);

/// A camera pose supported by map points.
struct ProjectionAlignment {
  Pose3 T_map_camera;
  /// Of the pose, [rho; phi] right perturbation (vision/pose_optimizer.h).
  Eigen::Matrix<double, 6, 6> information = Eigen::Matrix<double, 6, 6>::Zero();
  std::vector<AlignmentMatch> inliers;
  int num_offered = 0;  ///< matches that the inliers were chosen from
  int num_cells = 0;    ///< of a 4x4 grid over the image, those that hold inliers
  ViewAgreement agreement;
};

/// Refines a rough T_map_camera by guided matching: projects `points`, matches them within 12 and then 6 pixels (at
/// octave 0), optimises the pose after each round and keeps what agrees in pixel and in depth. nullopt when the
/// matches do not hold a pose: a normal outcome.
std::optional<ProjectionAlignment> AlignByProjection(const QueryKeyframe& query, std::span<const PointRecord> points,
                                                     const Pose3& T_map_camera);

/// What the camera should see again: points of the map met at about this angle before, whose descriptors should still
/// be alike; those behind something nearer included.
std::vector<ExpectedPoint> ExpectedPoints(const QueryKeyframe& query, std::span<const PointRecord> points,
                                          const Pose3& T_map_camera);

/// Live map points seen by frames of the map that look at about the same place as a camera at `T_map_camera`: the
/// nearest such frames of other sessions than `besides` (SessionId(): of all), a bounded number of them.
StatusOr<std::vector<PointRecord>> PointsSeenNear(MapReader& reader, MapId map, SessionId besides,
                                                  const Pose3& T_map_camera);

}  // namespace mapp
