#include "server/changes/witness_views.h"

#include "mapp/codec/keyframe_codec.h"
#include "storage/map_store.h"

namespace mapp {

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
      frame, MeasuredView(keyframe, frame.T_frame_camera, camera->second, range_m_, session.scale_map_session));
  kept_.emplace_front(frame.id, view);
  index_[frame.id] = kept_.begin();
  if (kept_.size() > max_kept_) {
    index_.erase(kept_.back().first);
    kept_.pop_back();
  }
  return view;
}

}  // namespace mapp
