#pragma once

#include <memory>

#include "mapp/base/id.h"
#include "mapp/base/status.h"

namespace mapp {

class MapStore;
class SessionEvents;
class TileCache;

struct RegistrarOptions {
  int max_candidates = 8;           ///< frames verified per keyframe
  int min_inliers = 30;             ///< map points matched and consistent, per keyframe
  double min_inlier_ratio = 0.4;    ///< of the matches offered to the final guided check
  int min_consistent_keyframes = 3; ///< that agree before a merge (DESIGN 7)
  double max_disagreement_m = 0.15; ///< between their T_map_session, at the keyframe
  double max_disagreement_deg = 4.0;
};

/// Place recognition, alignment and merging of fragments (DESIGN 7), in a thread of its own.
/// Thread-safe. Publishes AlignmentTried for every keyframe of a fragment, and SessionAligned.
class Registrar {
 public:
  Registrar(MapStore& store, TileCache& tiles, SessionEvents& events, const RegistrarOptions& options);
  ~Registrar();

  /// Tells of a stored keyframe; returns at once. Frames in the map are indexed; those of a fragment are indexed
  /// under the fragment and compared with the map. When a map's frames were never loaded (after a start), they are
  /// indexed first.
  void OnKeyframeStored(MapId map, SessionId session, FrameId frame, bool in_map);
  /// Forgets the map's index.
  void OnMapDeleted(MapId map);
  /// Ends the thread after the work in hand. Idempotent.
  void Shutdown();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace mapp
