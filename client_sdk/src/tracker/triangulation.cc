#include "client_sdk/src/tracker/triangulation.h"

#include "client_sdk/src/tracker/depth_points.h"
#include "vision/matching.h"
#include "vision/two_view.h"

#include <Eigen/Geometry>

#include <memory>
#include <optional>

namespace mapp::tracker {
namespace {

constexpr double kMinParallaxCosine = 0.9998;  ///< about 1.1 degrees (Mur-Artal et al. 2015)
/// A third of that where nothing else tells depth: what is far holds the rotation, however uncertain its depth, and
/// must be in the map before what is near leaves the view, or scale is lost with it.
constexpr double kMinParallaxCosineMono = 0.99998;
constexpr double kChi2Mono = 5.991;
/// Points are made no nearer than this many times the depth at which they are of any use.
constexpr double kMinDepthShare = 2;
/// Nearer cameras see too little parallax to be worth the matching; of what stands for a metre.
constexpr double kMinBaseline = 0.03;

struct View {
  std::shared_ptr<const Frame> frame;
  Pose3 T_session_camera;
  std::vector<int> open;  ///< features without a point
};

View CopyView(const SessionMap& map, int keyframe_idx) {
  const MapKeyframe& keyframe = map.keyframe(keyframe_idx);
  View view{keyframe.frame, keyframe.T_session_camera, {}};
  for (size_t feature = 0; feature < keyframe.points.size(); ++feature) {
    if (keyframe.points[feature] == kNone) view.open.push_back(static_cast<int>(feature));
  }
  return view;
}

std::vector<OrbDescriptor> OpenDescriptors(const View& view) {
  std::vector<OrbDescriptor> descriptors;
  descriptors.reserve(view.open.size());
  for (const int feature : view.open) {
    descriptors.push_back(view.frame->features[static_cast<size_t>(feature)].descriptor);
  }
  return descriptors;
}

/// Whether the point reprojects to the feature, in front of the camera.
bool Reprojects(const View& view, const TrackingCamera& camera, int feature_idx, const Eigen::Vector3d& p_session) {
  const Eigen::Vector3d p_camera = view.T_session_camera.Inverse() * p_session;
  if (p_camera.z() < kMinDepthShare * camera.min_point_depth_m) return false;
  const auto feature = static_cast<size_t>(feature_idx);
  const auto sigma_px = static_cast<double>(OctaveScale(view.frame->features[feature].keypoint.octave));
  return (camera.pinhole.Project(p_camera) - view.frame->pixels[feature]).squaredNorm() <
         kChi2Mono * sigma_px * sigma_px;
}

std::optional<Eigen::Vector3d> Triangulate(const View& a, const View& b, const TrackingCamera& camera, int feature_a,
                                           int feature_b) {
  const auto ray = [&camera](const View& view, int feature) {
    const Eigen::Vector3d d_camera = camera.pinhole.Unproject(view.frame->pixels[static_cast<size_t>(feature)]);
    return Eigen::Vector3d(view.T_session_camera.rotation() * d_camera.normalized());
  };
  std::optional<Eigen::Vector3d> p_session =
      IntersectRays(a.T_session_camera.translation(), ray(a, feature_a), b.T_session_camera.translation(),
                    ray(b, feature_b), camera.metric() ? kMinParallaxCosine : kMinParallaxCosineMono);
  // Too far for this motion, but perhaps not for the stereo baseline: a measured depth that fits both views will do.
  if (!p_session &&
      static_cast<double>(a.frame->depths_m[static_cast<size_t>(feature_a)]) >= camera.min_point_depth_m) {
    p_session = DepthPoint(*a.frame, static_cast<size_t>(feature_a), camera, a.T_session_camera);
  }
  if (!p_session || !Reprojects(a, camera, feature_a, *p_session) || !Reprojects(b, camera, feature_b, *p_session)) {
    return std::nullopt;
  }
  return p_session;
}

}  // namespace

std::vector<int> TriangulateWithNeighbors(SharedSessionMap& shared, const TrackingCamera& camera, int keyframe_idx,
                                          const std::vector<int>& neighbors) {
  std::vector<int> made;
  MatchOptions options;
  options.max_distance = 50;
  for (const int neighbor_idx : neighbors) {
    View own, other;
    double metre = 1;
    {
      MutexLock lock(shared.mutex);
      metre = camera.MetreAt(shared.map.MedianDepth(keyframe_idx));
      own = CopyView(shared.map, keyframe_idx);
      other = CopyView(shared.map, neighbor_idx);
    }
    if (Distance(own.T_session_camera, other.T_session_camera) < kMinBaseline * metre) continue;
    for (const Match& match : MatchDescriptors(OpenDescriptors(own), OpenDescriptors(other), options)) {
      const int own_feature = own.open[static_cast<size_t>(match.query_idx)];
      const int other_feature = other.open[static_cast<size_t>(match.train_idx)];
      const auto p_session = Triangulate(own, other, camera, own_feature, other_feature);
      if (!p_session) continue;
      MutexLock lock(shared.mutex);
      const int point_idx = shared.map.AddPoint(*p_session, keyframe_idx, own_feature);
      shared.map.AddObservation(point_idx, neighbor_idx, other_feature);
      shared.map.UpdateView(point_idx);
      made.push_back(point_idx);
    }
  }
  return made;
}

}  // namespace mapp::tracker
