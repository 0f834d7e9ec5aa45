#pragma once

#include "mapp/base/status.h"
#include "server/service/associator.h"
#include "server/service/keyframe_evidence.h"
#include "server/service/tile_cache.h"
#include "storage/records.h"

#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace mapp {

class MapWriter;

/// A keyframe on its way into the map or into its session's fragment. Borrows what it refers to.
struct KeyframeToWrite {
  const Keyframe& keyframe;  ///< lengths in the unit of the frame below (ScaleLengths)
  const std::string& packet;
  const Camera& camera;
  const SessionRecord& session;
  bool in_map = false;
  Pose3 T_frame_camera;  ///< T_map_camera when in_map, else T_session_camera
  /// Map points that features show, found before the transaction; those no longer live are passed over.
  std::span<const Association> associations;
  /// Told the points that its references lead to. False: the keyframe goes to the log alone, in its session's frame.
  /// Empty: it is admitted.
  std::function<bool(std::span<const KnownPoint>)> admit;
  /// A frame of the log that is to enter the map after all, instead of a new one.
  std::optional<FrameId> logged_frame;
};

struct WrittenKeyframe {
  FrameId frame;
  bool admitted = true;
  Revision revision;
  /// What it did to the map's tiles; empty for a fragment.
  std::vector<TileChange> changes;
};

/// Stores the keyframe within the transaction: its frame, the points that it founds, and what it adds to known ones.
///
/// Each feature with a point goes, in this order, to the live point that its reference stands for; to the point it is
/// associated with; or, when the reference is one of the session's own numbers, to a new point rebuilt from its depth.
/// A session's point that is associated is entered as fused into the map's, so that its number keeps leading there.
/// A point is observed once a keyframe: of several features that claim it the first one has it.
StatusOr<WrittenKeyframe> WriteKeyframe(MapWriter& writer, const KeyframeToWrite& input);

}  // namespace mapp
