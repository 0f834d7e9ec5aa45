#include "server/changes/witness_views.h"

#include "mapp/codec/keyframe_codec.h"
#include "storage/map_store.h"

namespace mapp {

WitnessViews::WitnessViews(MapReader& reader, Mutex& mutex, const MapRecord& map, size_t max_kept)
    : mutex_(mutex), reader_(reader), range_m_(map.cone_range_m), max_kept_(max_kept) {}

StatusOr<std::shared_ptr<const WitnessView>> WitnessViews::Get(const FrameRecord& frame, const SessionRecord& session) {
  Packet packet;
  {
    const MutexLock lock(mutex_);
    if (const auto found = index_.find(frame.id); found != index_.end()) {
      kept_.splice(kept_.begin(), kept_, found->second);
      return found->second->second;
    }
    MAPP_ASSIGN_OR_RETURN(packet, Read(frame));
  }
  MAPP_ASSIGN_OR_RETURN(const Keyframe keyframe, DecodeKeyframe(packet.bytes));
  auto view = std::make_shared<const WitnessView>(
      frame, MeasuredView(keyframe, frame.T_frame_camera, packet.camera, range_m_, session.scale_map_session));
  const MutexLock lock(mutex_);
  // Two threads may have read it at once.
  if (index_.contains(frame.id)) return view;
  kept_.emplace_front(frame.id, view);
  index_[frame.id] = kept_.begin();
  if (kept_.size() > max_kept_) {
    index_.erase(kept_.back().first);
    kept_.pop_back();
  }
  return view;
}

StatusOr<WitnessViews::Packet> WitnessViews::Read(const FrameRecord& frame) {
  auto camera = cameras_.find(frame.camera);
  if (camera == cameras_.end()) {
    MAPP_ASSIGN_OR_RETURN(const CameraRecord record, reader_.GetCamera(frame.camera));
    camera = cameras_.emplace(frame.camera, record.camera).first;
  }
  MAPP_ASSIGN_OR_RETURN(std::string bytes, reader_.GetPacket(frame.id));
  return Packet{camera->second, std::move(bytes)};
}

}  // namespace mapp
