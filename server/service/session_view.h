#pragma once

#include "mapp/base/status.h"
#include "mapp/map/keyframe.h"
#include "server/service/overlap_assessor.h"
#include "storage/records.h"

#include <string>

namespace mapp {

class MapReader;

/// A session with its map and camera, as one snapshot has them.
struct SessionView {
  SessionRecord session;
  MapRecord map;
  Camera camera;
};

/// NOT_FOUND: no such session.
StatusOr<SessionView> LoadSession(MapReader& reader, SessionId session);

/// FAILED_PRECONDITION when the session is closed.
Status CheckOpen(const SessionRecord& session);

/// False for a single camera: its depths are triangulated, in a unit of the session's own.
inline bool MeasuresDepth(SensorKind sensor) { return sensor != SensorKind::kMono; }

/// Multiplies the keyframe's depths by `scale`, and its position where that is in the session's frame. With the
/// session's scale_map_session, T_map_session takes it to the map.
void ScaleLengths(Keyframe& keyframe, double scale);

/// FAILED_PRECONDITION for a session in units of its own: what it asks about a view, and what it would be sent, is in
/// the map's.
Status CheckMeasuresDepth(const SessionRecord& session);

/// Where a pose that the session's device tells lies in the map. INVALID_ARGUMENT, naming `field`: not finite, or
/// beyond kMaxCoordinateM. FAILED_PRECONDITION: the session is not aligned. Lengths are in the map's unit
/// (ScaleLengths).
StatusOr<Pose3> PoseInMap(const SessionRecord& session, PoseFrame pose_frame, const Pose3& T_frame_camera,
                          const std::string& field);

/// The same, with what else the map needs to know of the view.
StatusOr<MapView> ViewInMap(const SessionView& view, PoseFrame pose_frame, const Pose3& T_frame_camera,
                            const std::string& field);

}  // namespace mapp
