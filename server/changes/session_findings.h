#pragma once

#include "mapp/base/call_context.h"
#include "mapp/base/mutex.h"
#include "mapp/base/status.h"
#include "mapp/view/point_judge.h"
#include "server/changes/point_tiles.h"
#include "server/changes/witness_views.h"
#include "storage/records.h"

#include <Eigen/Core>

#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace mapp {

/// What refinement moves a frame or a point by changes nothing that is judged: a fraction of the match radius at a
/// metre's depth.
inline constexpr double kStillM = 0.03;
inline constexpr double kStillRad = 0.01;

/// Where a frame stood when it was used as a witness.
struct WitnessFrame {
  FrameId frame;
  Pose3 T_map_camera;
};

/// What is known from one session of points, its own and others'.
struct SessionFindings {
  SessionId session;
  std::vector<WitnessFrame> frames;  ///< that it rests on, by id
  /// By the session's views, of points that it or sessions before it brought.
  std::vector<PointFinding> own;
  /// By views of sessions before it, of points that it brought: whether their places were seen free.
  std::map<SessionId, std::vector<PointFinding>> earlier;
  /// `own` holds what the session's device has reported as well (device_evidence.h). Not encoded.
  bool has_evidence = false;

  /// Whether it rests on these frames, standing where they did but for what refinement moves.
  bool RestsOn(std::span<const FrameRecord> frames_of_session) const;
};

/// docs/formats/findings.md. DecodeFindings: DATA_LOSS for what EncodeFindings did not write.
std::string EncodeFindings(const SessionFindings& findings);
StatusOr<SessionFindings> DecodeFindings(std::string_view bytes);

struct FindingsOptions {
  PointJudgeOptions judge;
  /// Earlier sessions that are asked about new points of a tile, the latest first.
  size_t max_earlier_sessions = 4;
  /// Views of one earlier session that are asked about a tile's new points, the nearest first.
  size_t max_earlier_views = 16;
  size_t max_kept_views = 4096;
  size_t max_kept_points = 2'000'000;
};

/// Makes the findings of one map's sessions, which are best asked for in the order of their ids: a session is compared
/// with those before it alone, so that what is made stays right when others follow. Thread-safe.
class FindingsMaker {
 public:
  /// Borrows the reader. `sessions`: all of the map. `frames`: those that stand in the map, by id.
  FindingsMaker(MapReader& reader, const MapRecord& map, std::span<const SessionRecord> sessions,
                std::span<const FrameRecord> frames, const FindingsOptions& options);

  StatusOr<SessionFindings> Make(const CallContext& context, SessionId session, int num_threads = 1);
  std::span<const FrameRecord> FramesOf(SessionId session) const;
  /// Views of the session that may see into the box, at most `max_views` of those nearest to it; empty for a session
  /// that the map does not have.
  StatusOr<std::vector<std::shared_ptr<const WitnessView>>> ViewsInto(SessionId session, const Aabb& box_map,
                                                                      size_t max_views);

  /// The map's points in tiles that meet the box.
  StatusOr<std::vector<PointTiles::Points>> PointsIn(const Aabb& box_map) { return tiles_.InBox(box_map); }

 private:
  struct Session {
    SessionRecord record;
    std::vector<FrameRecord> frames;
  };
  using NewPoints = std::vector<PointTiles::Points>;

  /// Judges with the session's own views, and returns what it brought to the tiles that they see.
  StatusOr<NewPoints> Judge(const CallContext& context, const Session& session, int num_threads, PointJudge& judge);
  Status AskEarlier(const CallContext& context, const NewPoints& new_points, int num_threads,
                    SessionFindings& findings);
  /// The latest of the sessions before `session` that have views of the points.
  Status AskEarlierAbout(const PointTiles::Points& points, SessionId session, std::map<SessionId, PointJudge>& judges);

  const FindingsOptions options_;
  const double range_m_;
  std::map<SessionId, Session> sessions_;
  Mutex reading_;
  WitnessViews views_;
  PointTiles tiles_;
};

}  // namespace mapp
