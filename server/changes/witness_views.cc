#include "server/changes/witness_views.h"

#include "mapp/codec/keyframe_codec.h"
#include "mapp/view/view_cone.h"
#include "storage/map_store.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace mapp {
namespace {

/// Ratio of the distance to an image corner to its depth.
double GreatestSecant(const Camera& camera) {
  double greatest = 1;
  for (const double u_px : {0.0, camera.width_px - 1.0}) {
    for (const double v_px : {0.0, camera.height_px - 1.0}) {
      greatest = std::max(greatest, camera.Unproject({u_px, v_px}).norm());
    }
  }
  return greatest;
}

}  // namespace

WitnessView::WitnessView(const FrameRecord& record, const Camera& with_camera, double with_range_m,
                         SeenGeometry with_geometry, bool is_complete)
    : frame(record.id),
      stamp_ns(record.stamp_ns),
      T_map_camera(record.T_frame_camera),
      camera(with_camera),
      range_m(with_range_m),
      complete(is_complete),
      geometry(std::move(with_geometry)) {
  // A point beyond everything that was measured has nothing behind it that would show it missing.
  const double reach_m = std::min(range_m, geometry.farthest_depth_m() * GreatestSecant(camera));
  box_map = ViewCone{T_map_camera, reach_m, camera.FieldOfView()}.BoundingBox();
}

WitnessViews::WitnessViews(MapReader& reader, const MapRecord& map, size_t max_kept)
    : reader_(reader), range_m_(map.cone_range_m), max_kept_(max_kept) {}

StatusOr<std::shared_ptr<const WitnessView>> WitnessViews::Get(const FrameRecord& frame, const SessionRecord& session) {
  if (const auto found = index_.find(frame.id); found != index_.end()) {
    kept_.splice(kept_.begin(), kept_, found->second);
    return found->second->second;
  }
  auto camera = cameras_.find(frame.camera);
  if (camera == cameras_.end()) {
    MAPP_ASSIGN_OR_RETURN(const CameraRecord record, reader_.GetCamera(frame.camera));
    camera = cameras_.emplace(frame.camera, record.camera).first;
  }
  MAPP_ASSIGN_OR_RETURN(const std::string packet, reader_.GetPacket(frame.id));
  MAPP_ASSIGN_OR_RETURN(const Keyframe keyframe, DecodeKeyframe(packet));
  auto view = std::make_shared<const WitnessView>(
      frame, camera->second, range_m_,
      SeenGeometry(OwnSurfacePoints(keyframe, camera->second, session.scale_map_session)),
      !keyframe.partial || keyframe.raster.has_value());
  kept_.emplace_front(frame.id, view);
  index_[frame.id] = kept_.begin();
  if (kept_.size() > max_kept_) {
    index_.erase(kept_.back().first);
    kept_.pop_back();
  }
  return view;
}

}  // namespace mapp
