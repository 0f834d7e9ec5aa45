#pragma once

#include "mapp/base/call_context.h"
#include "server/service/merger.h"
#include "storage/map_store.h"

#include <cstdint>
#include <set>
#include <span>
#include <unordered_map>
#include <vector>

namespace mapp {

/// Points of the map that are one in truth: what a keyframe saw before its session was aligned well enough, or came
/// back to after it had drifted, it mapped anew. Each keyframe is compared with what others mapped where it looks, as
/// FindFusions does with a fragment's; pairs with the most keyframes' votes come first, and points that one keyframe
/// sees side by side are never joined. From the point that goes to the one that stays. `frames` are those to compare,
/// in the map. Errors: the reader's, CANCELLED or DEADLINE_EXCEEDED of `context`.
StatusOr<PointFusions> FindDuplicatePoints(const CallContext& context, MapReader& reader,
                                           std::span<const FrameRecord> frames);

/// Finds and fuses them; how many there were. Publishes TilesChanged to the map. Errors: FindDuplicatePoints' and the
/// store's.
StatusOr<uint32_t> FuseDuplicates(MapStore& store, TileCache& tiles, SessionEvents& events, const CallContext& context,
                                  MapId map, std::span<const FrameRecord> frames);

/// Fuses duplicates as a change to the store: observations go over to the point that stays.
class DuplicateFusion {
 public:
  /// `fusions` must outlive this.
  DuplicateFusion(MapId map, const PointFusions& fusions) : map_(map), fusions_(fusions) {}

  /// Inside MapStore::Write. Points that have gone meanwhile are left out. Errors: the writer's.
  Status Run(MapWriter& writer);

  uint32_t num_fused() const { return num_fused_; }
  Revision revision() const { return revision_; }
  std::vector<TileKey> touched_tiles() const { return {tiles_.begin(), tiles_.end()}; }

 private:
  Status LoadPoints(MapWriter& writer);
  Status RewriteFrame(MapWriter& writer, const FrameRecord& frame);
  /// Where the camera of a frame may stand that sees one of the points.
  Aabb WhereSeenFrom() const;
  StatusOr<Eigen::Vector3d> CenterOf(MapWriter& writer, FrameId frame);
  /// The point that `point` becomes, or nullptr when it stays itself.
  PointRecord* TargetOf(MapPointId point);

  const MapId map_;
  const PointFusions& fusions_;
  std::unordered_map<MapPointId, PointRecord> points_;  ///< live, on either side of a fusion
  std::unordered_map<FrameId, Eigen::Vector3d> centers_;
  std::set<TileKey> tiles_;
  Revision revision_;
  uint32_t num_fused_ = 0;
};

}  // namespace mapp
