#pragma once

#include "server/service/optimizer_region.h"

#include <span>
#include <vector>

namespace mapp {

/// Whose frames these all are, if one session's.
std::optional<SessionId> SoleSession(std::span<const FrameRecord> frames);

/// Writes an adjusted region back to the map: poses, points, what is carried along with them, frames and points that
/// arrived since the snapshot; and drops the observations that the adjustment found to be wrong.
class OptimizerCommit {
 public:
  /// `region` as loaded; `adjusted` its problem after adjustment; `outliers` per observation. All must outlive this.
  OptimizerCommit(const OptimizerRegion& region, const BundleProblem& adjusted, const std::vector<bool>& outliers)
      : region_(region), adjusted_(adjusted), outliers_(outliers) {}

  /// Inside MapStore::Write. ABORTED when a frame of the region was moved or taken out of the map meanwhile.
  Status Run(MapWriter& writer);

  MapId map() const { return region_.frames.front().map; }
  Revision revision() const { return revision_; }
  const std::vector<TileKey>& touched_tiles() const { return touched_tiles_; }

 private:
  struct Motion {
    MapPointId point;
    Eigen::Vector3d position;
    Eigen::Quaterniond turn = Eigen::Quaterniond::Identity();  ///< of what it goes with
  };

  /// T_new_old: how the adjusted frame moved, in the map's frame.
  Pose3 MotionOf(int frame_idx) const;
  Status CheckUnchanged(MapWriter& writer) const;
  Status MoveFrames(MapWriter& writer);
  /// Carries frames that came after the snapshot along with their reference, and notes the motion of their new points.
  Status CarryArrived(MapWriter& writer, std::vector<Motion>& motions);
  std::vector<Motion> PointMotions() const;
  Status MovePoints(MapWriter& writer, const std::vector<Motion>& motions);
  Status DropOutliers(MapWriter& writer) const;
  Status DropOutliersOfFrame(MapWriter& writer, FrameId frame, const std::vector<Observation>& dropped) const;

  const OptimizerRegion& region_;
  const BundleProblem& adjusted_;
  const std::vector<bool>& outliers_;
  Revision revision_;
  std::vector<TileKey> touched_tiles_;
};

}  // namespace mapp
