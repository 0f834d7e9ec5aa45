#pragma once

#include "mapp/base/status.h"
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

/// Where a pose that the session's device tells lies in the map. INVALID_ARGUMENT, naming `field`: not finite, or
/// beyond kMaxCoordinateM. FAILED_PRECONDITION: the session is not aligned.
StatusOr<Pose3> PoseInMap(const SessionRecord& session, PoseFrame pose_frame, const Pose3& T_frame_camera,
                          const std::string& field);

/// The same, with what else the map needs to know of the view.
StatusOr<MapView> ViewInMap(const SessionView& view, PoseFrame pose_frame, const Pose3& T_frame_camera,
                            const std::string& field);

}  // namespace mapp
