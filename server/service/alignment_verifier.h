#pragma once

#include "server/service/alignment_projection.h"
#include "server/service/registrar.h"

#include <optional>
#include <span>
#include <vector>

namespace mapp {

/// One keyframe's word on where its session lies in the map.
struct KeyframeAlignment {
  uint32_t number = 0;  ///< the keyframe's
  Pose3 T_session_camera;
  ProjectionAlignment match;

  Sim3 S_map_session() const {
    const Eigen::Quaterniond R_map_session = match.T_map_camera.rotation() * T_session_camera.rotation().conjugate();
    const Eigen::Vector3d way_map = match.scale * (R_map_session * T_session_camera.translation());
    return {match.scale, Pose3(R_map_session, match.T_map_camera.translation() - way_map)};
  }
};

struct VerificationResult {
  int best_inliers = 0;  ///< of the best place tried, accepted or not
  std::optional<KeyframeAlignment> alignment;
};

/// Geometric verification (DESIGN 7): does the keyframe `query` see what one of the `candidates`, frames of the map
/// besides its `own`, saw? Candidates that stand together are tried as one place: descriptors matched against
/// each, a rigid motion between the keyframe's own points and the map's by RANSAC (for depths without scale, the
/// camera's pose by the map's points and their pixels, and then the depths' scale), then guided matching with all
/// points around. A keyframe that two places explain about equally well proves nothing and gives no alignment. Errors
/// are the reader's.
StatusOr<VerificationResult> VerifyCandidates(MapReader& reader, const FrameView& query,
                                              std::span<const FrameId> candidates, const OwnFrames& own,
                                              const RegistrarOptions& options);

}  // namespace mapp
