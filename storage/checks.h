#pragma once

#include "mapp/base/status.h"
#include "mapp/map/tile.h"
#include "storage/records.h"

#include <exception>
#include <optional>
#include <string>

namespace mapp::internal {

// What every engine refuses, and in which words: the same mistake gives the same code and message whatever keeps the
// maps. Checks are OK or say what was wrong; the others make the Status.

Status NoSuchMap(MapId map);
Status NoSuchMap(const std::string& name);
Status NoSuchSession(SessionId session);
Status NoSuchCamera(CameraId camera);
Status NoSuchFrame(FrameId frame);
Status NoSuchPoint(MapPointId point);
Status NoSuchTag(const MapRecord& map, const std::string& tag);
Status MapExists(const std::string& name);
Status NoSuchChange(ChangeId change);
Status EvidenceIsStored(const EvidenceRecord& evidence);
Status KeyframeIsStored(const FrameRecord& frame, FrameId stored);

/// Whether the map can be created; its name aside.
Status CheckMap(const MapRecord& map);
Status CheckCamera(const Camera& camera);
/// What UpdateSession writes.
Status CheckSession(const SessionRecord& session);
/// `map` is that of the frame's session.
Status CheckFrame(const FrameRecord& frame, MapId map);
Status CheckPose(const Pose3& T_frame_camera);
Status CheckPoint(const PointRecord& point);
/// `map_of_session` is that of the point's session, `map` the one it is meant for.
Status CheckPointsMap(const PointRecord& point, MapId map_of_session, MapId map);
/// Whether `retired` may fuse into `successor`, both live, of these maps.
Status CheckFusion(MapId map_of_retired, MapId map_of_successor);
Status CheckFusesIntoAnother(MapPointId retired, std::optional<MapPointId> fused_into);
/// Why a point cannot be returned.
Status NeverLived(MapPointId point);
Status StillLives(MapPointId point);
Status IsFused(MapPointId point);
Status HasAnotherNumber(const PointRecord& point);
/// All that the record says by itself.
Status CheckChange(const ChangeRecord& change);
/// Whether `change` may rest on a session of that map, or replace a change of it.
Status CheckChangesSession(const ChangeRecord& change, SessionId session, MapId map_of_session);
Status CheckChangesMap(const ChangeRecord& change, MapId map_of_stored);
Status CheckCause(RevisionCause cause);
/// Why a session cannot be erased yet.
Status StillHoldsFrames(SessionId session);
Status StillHoldsPoints(SessionId session);
Status StillFounds(SessionId session);
Status StillHasHistory(const MapRecord& map);
Status CheckTagName(const std::string& name);
/// OUT_OF_RANGE when the map has not, or no longer, the state of `revision`.
Status CheckRevision(const MapRecord& map, Revision revision);
Status CheckRevisionOrder(Revision from, Revision to);

/// The tile that holds `p_map`; INVALID_ARGUMENT outside of the tiling.
StatusOr<TileKey> TileAt(double tile_edge_m, const Eigen::Vector3d& p_map);

Status StoreIsClosed();
Status WaitedPastDeadline();
Status ChangeThrew(const std::exception& error);

}  // namespace mapp::internal
