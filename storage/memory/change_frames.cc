// Frames of a change: their half of MapWriter.
#include "storage/checks.h"
#include "storage/memory/change.h"

namespace mapp::memory {
namespace {

std::shared_ptr<const std::vector<Observation>> Share(std::span<const Observation> observations) {
  return std::make_shared<const std::vector<Observation>>(observations.begin(), observations.end());
}

}  // namespace

StatusOr<FrameId> Change::InsertFrame(const FrameRecord& frame, const std::string& packet,
                                      std::span<const Observation> observations) {
  MAPP_RETURN_IF_ERROR(internal::CheckPose(frame.T_frame_camera));
  const MapState* const map = contents_.MapOfSession(frame.session);
  if (map == nullptr) return internal::NoSuchSession(frame.session);
  const MapId map_id = map->record.id;
  MAPP_RETURN_IF_ERROR(internal::CheckFrame(frame, map_id));
  const FrameId* const stored = map->frames_by_number.Find({frame.session, frame.number});
  if (stored != nullptr) return internal::KeyframeIsStored(frame, *stored);

  MapState& revised = Revise(map_id);
  if (Draft& draft = Edit(map_id); draft.cause == RevisionCause::kUnknown) {
    draft.cause = RevisionCause::kKeyframe;
    draft.session = frame.session;
  }
  StoredFrame inserted{
      .record = frame, .packet = std::make_shared<const std::string>(packet), .observations = Share(observations)};
  inserted.record.id = FrameId(contents_.next.frame++);
  inserted.record.num_packet_bytes = static_cast<int64_t>(packet.size());
  inserted.record.created = revised.record.revision;
  revised.frames.Set(inserted.record.id, inserted);
  revised.frames_by_number.Set({frame.session, frame.number}, inserted.record.id);
  revised.record.num_frames += frame.in_map ? 1 : 0;
  SessionRecord session = *revised.sessions.Find(frame.session);
  ++session.num_keyframes;
  session.num_upload_bytes += inserted.record.num_packet_bytes;
  revised.sessions.Set(frame.session, std::move(session));
  return inserted.record.id;
}

Status Change::SetFramePose(FrameId frame, bool in_map, const Pose3& T_frame_camera) {
  MAPP_RETURN_IF_ERROR(internal::CheckPose(T_frame_camera));
  const MapState* const map = contents_.MapOfFrame(frame);
  if (map == nullptr) return internal::NoSuchFrame(frame);
  MapState& revised = Revise(map->record.id);
  StoredFrame moved = *revised.frames.Find(frame);
  revised.record.num_frames += static_cast<int>(in_map) - static_cast<int>(moved.record.in_map);
  moved.record.in_map = in_map;
  moved.record.T_frame_camera = T_frame_camera;
  revised.frames.Set(frame, std::move(moved));
  return absl::OkStatus();
}

Status Change::SetObservations(FrameId frame, std::span<const Observation> observations) {
  const MapState* const map = contents_.MapOfFrame(frame);
  if (map == nullptr) return internal::NoSuchFrame(frame);
  MapState& revised = Revise(map->record.id);
  StoredFrame updated = *revised.frames.Find(frame);
  updated.observations = Share(observations);
  revised.frames.Set(frame, std::move(updated));
  return absl::OkStatus();
}

}  // namespace mapp::memory
