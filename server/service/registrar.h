#pragma once

#include "mapp/base/id.h"
#include "mapp/base/status.h"
#include "server/service/view_agreement.h"

#include <algorithm>
#include <functional>
#include <memory>
#include <vector>

namespace mapp {

class MapStore;
struct ClosedLoop;
class SessionEvents;
class SessionGuard;
class StepTimes;
class TileCache;

struct RegistrarOptions {
  int max_candidates = 8;         ///< frames verified per keyframe
  int min_inliers = 30;           ///< map points matched and consistent, per keyframe
  double min_inlier_ratio = 0.4;  ///< of the matches offered to the final guided check
  /// Cells of a 4x4 grid over the image that hold inliers: a match confined to one poster or one car tells little.
  int min_inlier_cells = 6;
  /// Cells of the view that contradict a pose must not be more than those that agree with it (view_agreement.h); up to
  /// this many are let pass: something may have moved.
  int max_contradicting_cells = 2;
  int min_consistent_keyframes = 3;  ///< that agree before a merge (DESIGN 7)
  /// Two keyframes suffice when both have this many inliers.
  int strong_inliers = 100;
  double max_disagreement_m = 0.15;  ///< between their S_map_session, at the keyframe
  double max_disagreement_deg = 4.0;
  /// A second place that explains the keyframe with this share of the best place's inliers makes it ambiguous: it then
  /// proves nothing (equal rooms, equal cars).
  double max_rival_share = 0.6;
  /// Told of a closed session that is to be optimized now: its last keyframe has been looked at, it has merged after
  /// all, or it was corrected for a loop. May be empty; must not block.
  std::function<void(SessionId)> on_optimization_due;
  /// Told of a session that came back to mapped ground and was corrected. May be empty; must not block.
  std::function<void(SessionId, const ClosedLoop&)> on_loop_closed;
  /// Told of what went wrong with a session in the background: a broken packet, a disk that fails; and with
  /// SessionId() with the index of a map. May be empty; must
  /// not block. A session or map deleted in the meantime is not an error.
  std::function<void(SessionId, const Status&)> on_error;
  /// Told how long each run took. Borrowed; may be null.
  StepTimes* step_times = nullptr;
  /// Told what a close look at doubtful keyframes says. Borrowed; may be null: then there is none.
  SessionGuard* guard = nullptr;
};

/// Whether the cells that contradict are few enough for the others.
inline bool Tolerates(const RegistrarOptions& options, const ViewAgreement& agreement) {
  return agreement.num_contradicting <= std::max(options.max_contradicting_cells, agreement.num_agreeing);
}

/// Place recognition, alignment and merging of fragments (DESIGN 7), in a thread of its own.
/// Thread-safe. Publishes AlignmentTried for every keyframe of a fragment, and SessionAligned.
/// A fragment that found no place in the map, closed or not, is tried again when a frame joins the map that looks like
/// one of its own: it merges as soon as the map has grown to where it was.
/// A fragment of another unit of length than the map's joins it by a similarity: that of a single camera takes the
/// map's scale, and the first one in metres gives its scale to a map that has none yet (map_scale.h). Quarantined
/// sessions are not compared with anything.
class Registrar {
 public:
  Registrar(MapStore& store, TileCache& tiles, SessionEvents& events, const RegistrarOptions& options);
  ~Registrar();

  /// Tells of a stored keyframe; returns at once. Frames in the map are indexed; those of a fragment are compared with
  /// the map, and indexed once it has merged. When a map's frames were never loaded (after a start), they are indexed
  /// first. `doubtful`: a frame in the map that did not look like the map there, to be checked (placement_check.h).
  void OnKeyframeStored(MapId map, SessionId session, FrameId frame, bool in_map, bool doubtful = false);
  /// The session sends no more, and is in the map: its optimization is due once its keyframes have been looked at, for
  /// a loop comes first (DESIGN 8).
  void OnSessionClosed(MapId map, SessionId session);
  /// Forgets the session's fragment, and the frames that were retired.
  void OnSessionQuarantined(MapId map, SessionId session, const std::vector<FrameId>& retired);
  /// Takes up the fragment of a session that was released.
  void OnSessionReleased(MapId map, SessionId session);
  /// Runs `work` between the looks at two keyframes, so that nothing is known meanwhile of a map but what its database
  /// says, and waits for it. UNAVAILABLE: too much waits, or the registrar has been shut down.
  Status RunAlone(MapId map, const std::function<Status()>& work);
  /// Waits until all that it was told of has been looked at, with what follows from it.
  void WaitUntilIdle();
  /// Makes the index of a map that came as a whole, before its first keyframe needs it.
  void OnMapImported(MapId map);
  /// Forgets the map's index.
  void OnMapDeleted(MapId map);
  /// Ends the thread after the work in hand; what still waits is taken up again after the next start. Idempotent.
  void Shutdown();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace mapp
