#include "eval/adapter/odometry_mapper.h"

#include "client_sdk/src/tracker/depth_points.h"
#include "client_sdk/src/tracker/frame.h"
#include "client_sdk/src/tracker/keyframe_export.h"
#include "client_sdk/src/tracker/local_window.h"
#include "client_sdk/src/tracker/point_search.h"
#include "client_sdk/src/tracker/session_map.h"
#include "vision/stereo_matcher.h"

#include <fmt/format.h>

#include <utility>
#include <vector>

namespace mapp {
namespace {

using tracker::kNone;

/// Fewer matches than this that agree on one motion are chance: the keyframe then begins its own points.
constexpr int kMinMatches = 12;
/// With fewer than this, points are looked for in a window twice as wide.
constexpr int kEnoughMatches = 50;
/// The only generation of the map: nothing is ever taken over from a server.
constexpr int kGeneration = 0;

}  // namespace

struct OdometryMapper::Impl {
  OdometryMapperOptions options;
  std::unique_ptr<tracker::FrameBuilder> builder;
  Pose3 T_left_camera;
  tracker::SessionMap map;
  std::vector<int> last_points;  ///< of the keyframe before, per feature

  /// Per feature of the frame, the point of the map that it shows.
  std::vector<int> FindPoints(const tracker::Frame& frame, const Pose3& T_session_camera) const {
    const tracker::TrackingCamera& camera = builder->camera();
    const tracker::LocalWindow window =
        tracker::GatherLocalWindow(map, last_points, T_session_camera, /*metre=*/1, kGeneration);
    tracker::SearchOptions search;
    search.radius_px = options.search_radius_px;
    const tracker::PoseEstimate found = tracker::SearchAndRefine(frame, camera, camera.own_map, T_session_camera,
                                                                 window.points, search, kEnoughMatches);
    if (found.num_inliers >= kMinMatches) return found.points;
    return std::vector<int>(frame.size(), kNone);
  }
};

OdometryMapper::OdometryMapper(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}

OdometryMapper::~OdometryMapper() = default;

StatusOr<std::unique_ptr<OdometryMapper>> OdometryMapper::Create(const Sequence& sequence,
                                                                 const OdometryMapperOptions& options) {
  if (sequence.sensor() != SensorKind::kStereo || !sequence.right_camera()) {
    return absl::InvalidArgumentError(fmt::format("{}: not a stereo sequence", sequence.name()));
  }
  auto impl = std::make_unique<Impl>();
  impl->options = options;
  OrbTrackerOptions tracker_options;
  tracker_options.max_depth_m = options.max_depth_m;
  MAPP_ASSIGN_OR_RETURN(impl->builder, tracker::MakeStereoFrameBuilder(sequence.camera(), *sequence.right_camera(),
                                                                       sequence.T_left_right(), tracker_options));
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<StereoRectifier> rectifier,
                        StereoRectifier::Create(sequence.camera(), *sequence.right_camera(), sequence.T_left_right()));
  impl->T_left_camera = rectifier->T_left_rectified();
  return std::unique_ptr<OdometryMapper>(new OdometryMapper(std::move(impl)));
}

const Camera& OdometryMapper::camera() const { return impl_->builder->camera().recorded; }

const Pose3& OdometryMapper::T_left_camera() const { return impl_->T_left_camera; }

StatusOr<Keyframe> OdometryMapper::Add(const SequenceFrame& images, const Pose3& T_session_camera) {
  const TrackerFrame tracker_frame{images.stamp_ns, images.gray.View(), {}, images.right_gray.View()};
  MAPP_RETURN_IF_ERROR(impl_->builder->Validate(tracker_frame));
  MAPP_ASSIGN_OR_RETURN(const std::shared_ptr<const tracker::Frame> frame, impl_->builder->Build(tracker_frame));

  tracker::SessionMap& map = impl_->map;
  const std::vector<int> found = impl_->FindPoints(*frame, T_session_camera);
  const int keyframe_idx = map.AddKeyframe(frame, T_session_camera, found, kGeneration);
  for (const int point_idx : found) {
    if (point_idx != kNone) map.UpdateView(point_idx);
  }
  const tracker::TrackingCamera& camera = impl_->builder->camera();
  for (const size_t feature : tracker::FeaturesForPoints(*frame, camera)) {
    if (map.keyframe(keyframe_idx).points[feature] != kNone) continue;
    map.AddPoint(tracker::DepthPoint(*frame, feature, camera, T_session_camera), keyframe_idx,
                 static_cast<int>(feature));
  }
  impl_->last_points = map.keyframe(keyframe_idx).points;

  Keyframe keyframe = tracker::ExportKeyframe(map, camera, keyframe_idx);
  keyframe.number = static_cast<uint32_t>(keyframe_idx);
  // What this image measured says more than where the drifted poses put the point.
  for (size_t feature = 0; feature < frame->size(); ++feature) {
    if (keyframe.features[feature].point && frame->depths_m[feature] > 0) {
      keyframe.features[feature].point->depth_m = frame->depths_m[feature];
    }
  }
  return keyframe;
}

}  // namespace mapp
