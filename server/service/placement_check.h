#pragma once

#include "mapp/base/status.h"
#include "server/service/alignment_verifier.h"
#include "server/service/keyframe_evidence.h"
#include "vision/place_index.h"

namespace mapp {

/// Frames of the map that other sessions brought and that look like the keyframe, the likest first. Errors are the
/// reader's.
StatusOr<std::vector<FrameId>> CandidatesOfOthers(MapReader& reader, const FrameView& view, const PlaceIndex& index,
                                                  const RegistrarOptions& options);

/// Whether a pose is off another by no more than odometry may have drifted over `way_m`: 0.5 m and 3 % of the way, 10
/// degrees.
bool IsWithinDrift(const Pose3& told, const Pose3& found, double way_m);

/// Looks closely at a keyframe of the map, of whose view the map showed little where its session places it: is it
/// there, elsewhere, or does it see something else? By the points of other sessions alone.
///
/// kAgrees: it is recognised where it stands, give or take what odometry may have drifted on the way since the session
/// was aligned (0.5 m and 3 % of the way, 10 degrees), or shows what the map holds there. kElsewhere: it is recognised
/// further away, as strictly as for an alignment. kUnlike: not recognised, and most of the view contradicts; whole
/// keyframes only, since redundancy control takes away what would agree. kSilent otherwise. Errors are the reader's.
StatusOr<KeyframeEvidence> CheckPlacement(MapReader& reader, const FrameView& view, const PlaceIndex& index,
                                          const RegistrarOptions& options);

}  // namespace mapp
