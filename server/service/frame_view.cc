#include "server/service/frame_view.h"

#include "mapp/codec/keyframe_codec.h"
#include "server/service/session_view.h"

#include <fmt/format.h>

#include <string>
#include <unordered_set>
#include <utility>

namespace mapp {
namespace {

/// Effective baseline of structured-light depth cameras, metres: 40 pixel metres at a focal length of 525 pixels, as
/// Mur-Artal and Tardos 2017 set it for the Kinect.
constexpr double kRgbdBaselineM = 0.076;

StatusOr<Keyframe> LoadKeyframe(MapReader& reader, FrameId frame) {
  MAPP_ASSIGN_OR_RETURN(const std::string packet, reader.GetPacket(frame));
  StatusOr<Keyframe> keyframe = DecodeKeyframe(packet);
  if (!keyframe.ok()) {
    return absl::DataLossError(
        fmt::format("frame {}: stored packet: {}", frame.value(), std::string(keyframe.status().message())));
  }
  return keyframe;
}

std::vector<OrbDescriptor> DescriptorsOf(const Keyframe& keyframe) {
  std::vector<OrbDescriptor> descriptors;
  descriptors.reserve(keyframe.features.size());
  for (const KeyframeFeature& feature : keyframe.features) descriptors.push_back(feature.descriptor);
  return descriptors;
}

/// Per feature, the point it observes, if that point is live.
StatusOr<std::vector<std::optional<MapPointId>>> LivePoints(MapReader& reader, const FrameView& view) {
  MAPP_ASSIGN_OR_RETURN(const std::vector<Observation> observations, reader.GetObservations(view.record.id));
  std::vector<MapPointId> observed;
  observed.reserve(observations.size());
  for (const Observation& observation : observations) observed.push_back(observation.point);
  MAPP_ASSIGN_OR_RETURN(const std::vector<PointRecord> live, reader.FindPoints(observed));
  std::unordered_set<MapPointId> live_ids;
  for (const PointRecord& point : live) live_ids.insert(point.id);

  std::vector<std::optional<MapPointId>> points(view.keyframe.features.size());
  for (const Observation& observation : observations) {
    if (observation.feature_idx >= points.size()) {
      return absl::DataLossError(fmt::format("frame {}: observation of feature {}, but its packet has {} features",
                                             view.record.id.value(), observation.feature_idx, points.size()));
    }
    if (live_ids.contains(observation.point)) points[observation.feature_idx] = observation.point;
  }
  return points;
}

}  // namespace

std::vector<OrbDescriptor> FrameView::Descriptors() const { return DescriptorsOf(keyframe); }

DepthKind DepthKindOf(const SessionRecord& session, const MapRecord& map) {
  const bool measured = MeasuresDepth(session.sensor);
  if (!session.T_map_session && !(measured && map.has_metric_scale)) return DepthKind::kUnscaled;
  return measured ? DepthKind::kMeasured : DepthKind::kTriangulated;
}

StatusOr<FrameView> LoadFrame(MapReader& reader, FrameId frame) {
  FrameView view;
  MAPP_ASSIGN_OR_RETURN(view.record, reader.GetFrame(frame));
  MAPP_ASSIGN_OR_RETURN(CameraRecord camera, reader.GetCamera(view.record.camera));
  view.camera = std::move(camera.camera);
  view.pinhole = view.camera.Undistorted();

  MAPP_ASSIGN_OR_RETURN(view.keyframe, LoadKeyframe(reader, frame));
  MAPP_ASSIGN_OR_RETURN(const SessionRecord session, reader.GetSession(view.record.session));
  MAPP_ASSIGN_OR_RETURN(const MapRecord map, reader.GetMap(view.record.map));
  ScaleLengths(view.keyframe, session.scale_map_session);
  view.depths = DepthKindOf(session, map);

  view.undistorted_px.reserve(view.keyframe.features.size());
  for (const KeyframeFeature& feature : view.keyframe.features) {
    const Eigen::Vector2d pixel(feature.keypoint.u_px, feature.keypoint.v_px);
    view.undistorted_px.push_back(view.pinhole.Project(view.camera.Unproject(pixel)));
  }
  MAPP_ASSIGN_OR_RETURN(view.points, LivePoints(reader, view));
  return view;
}

StatusOr<std::vector<OrbDescriptor>> LoadDescriptors(MapReader& reader, FrameId frame) {
  MAPP_ASSIGN_OR_RETURN(const Keyframe keyframe, LoadKeyframe(reader, frame));
  return DescriptorsOf(keyframe);
}

double DepthWeightBf(const Camera& camera) {
  const double baseline_m = camera.stereo_baseline_m > 0 ? camera.stereo_baseline_m : kRgbdBaselineM;
  return camera.FocalLengths().x() * baseline_m;
}

}  // namespace mapp
