#pragma once

#include "mapp/base/status.h"
#include "mapp/feature/feature.h"
#include "mapp/map/tile.h"
#include "server/service/point_tree.h"
#include "server/service/tile_cache.h"
#include "storage/records.h"

#include <algorithm>
#include <array>
#include <memory>
#include <span>
#include <unordered_map>
#include <vector>

namespace mapp {

/// A map point as the service searches it. Float coordinates: 0.1 mm at a kilometre from the origin.
struct LoadedPoint {
  Eigen::Vector3f p_map;
  uint32_t num_observers = 0;
  /// Per observer: index into LoadedTile::frames(), and the unit vector from its camera centre to the point.
  std::array<uint32_t, TilePoint::kMaxObservers> observer_frames{};
  std::array<Eigen::Vector3f, TilePoint::kMaxObservers> observer_directions;
  MapPointId id;
  Eigen::Vector3f view_direction;
  float reference_distance_m = 1;
  OrbDescriptor descriptor;
  float confidence = 1;
  uint32_t num_observations = 0;
};

/// One tile in memory: immutable points, the frames that saw them, and KD-trees.
///
/// Points lie in segments, each with a tree of its own. A change adds a small segment and hides the points it replaces;
/// a segment is merged into the one before it once it has grown to an eighth of its size, so that appending costs
/// amortised O(log n) tree insertions a point and a search meets three or four trees at most (as log-structured merge
/// trees do, O'Neil et al. 1996). Versions share the segments that they have in common.
class LoadedTile {
 public:
  /// Null when `points` is empty. Observers that `frames` does not hold are left out.
  static StatusOr<std::shared_ptr<const LoadedTile>> Create(const TileKey& key, Revision revision,
                                                            std::span<const PointRecord> points,
                                                            std::span<const ObserverFrame> frames);
  /// This tile after `change`; null when no point is left.
  StatusOr<std::shared_ptr<const LoadedTile>> With(const TileChange& change, Revision revision) const;

  const TileKey& key() const { return key_; }
  /// The map's revision when the tile was loaded or last changed.
  Revision revision() const { return revision_; }
  /// Frames that saw points of the tile; indices stay the same from version to version.
  const std::vector<ObserverFrame>& frames() const { return frames_->list; }
  size_t num_points() const { return num_points_; }
  /// Whether a frame of another session is among the point's observers.
  bool IsSeenByOthers(const LoadedPoint& point, SessionId session) const {
    return std::any_of(point.observer_frames.begin(), point.observer_frames.begin() + point.num_observers,
                       [&](uint32_t frame) { return frames()[frame].session != session; });
  }
  size_t num_segments() const { return parts_.size(); }
  /// Memory it holds, approximately.
  size_t bytes() const { return bytes_; }

  /// Calls `visit(const LoadedPoint&)` for every point.
  template <typename Visit>
  void ForEachPoint(const Visit& visit) const {
    for (const Part& part : parts_) {
      for (size_t i = 0; i < part.segment->points.size(); ++i) {
        if (!part.IsHidden(i)) visit(part.segment->points[i]);
      }
    }
  }

  /// Calls `visit(const Eigen::Vector3f& p_map, const LoadedPoint&)` for every point. Positions lie together, so that
  /// a visitor which passes most points over by their position does not read the rest of them.
  template <typename Visit>
  void ForEachPosition(const Visit& visit) const {
    for (const Part& part : parts_) {
      const std::vector<Eigen::Vector3f>& positions = part.segment->tree.points();
      for (size_t i = 0; i < positions.size(); ++i) {
        if (!part.IsHidden(i)) visit(positions[i], part.segment->points[i]);
      }
    }
  }

  /// Whether `accept(const LoadedPoint&)` holds for any point nearer to `p_map` than `radius_m`.
  template <typename Accept>
  bool AnyWithin(const Eigen::Vector3f& p_map, float radius_m, const Accept& accept) const {
    for (const Part& part : parts_) {
      const auto accept_live = [&](size_t i) { return !part.IsHidden(i) && accept(part.segment->points[i]); };
      if (part.segment->tree.AnyWithin(p_map, radius_m, accept_live)) return true;
    }
    return false;
  }

 private:
  struct Frames {
    std::vector<ObserverFrame> list;
    std::unordered_map<FrameId, uint32_t> index;
  };
  struct Segment {
    std::vector<LoadedPoint> points;  // ordered by id
    PointTree tree;
  };
  /// A segment and which of its points have been replaced or removed since it was built.
  struct Part {
    std::shared_ptr<const Segment> segment;
    std::shared_ptr<const std::vector<bool>> hidden;  // null when none is
    size_t num_hidden = 0;

    bool IsHidden(size_t i) const { return hidden != nullptr && (*hidden)[i]; }
    size_t num_live() const { return segment->points.size() - num_hidden; }
  };

  static StatusOr<Part> BuildPart(std::vector<LoadedPoint> points);
  static std::shared_ptr<const Frames> MergeFrames(std::shared_ptr<const Frames> present,
                                                   std::span<const ObserverFrame> added);
  static void Hide(std::vector<Part>& parts, std::span<const MapPointId> sorted_ids);
  static Status Compact(std::vector<Part>& parts);
  static StatusOr<std::shared_ptr<const LoadedTile>> Assemble(const TileKey& key, Revision revision,
                                                              std::vector<Part> parts,
                                                              std::shared_ptr<const Frames> frames);

  TileKey key_;
  Revision revision_;
  std::vector<Part> parts_;  // largest first
  std::shared_ptr<const Frames> frames_;
  size_t num_points_ = 0;
  size_t bytes_ = 0;
};

}  // namespace mapp
