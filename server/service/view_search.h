#pragma once

#include "mapp/view/view_cone.h"
#include "server/service/loaded_tile.h"

#include <cstdint>
#include <memory>
#include <numbers>
#include <span>
#include <vector>

namespace mapp {

/// Searches among the neighbour points of one view: the map points that its neighbour frames hold (DESIGN 5). Frames
/// are judged when first met. One thread only.
class ViewSearch {
 public:
  /// `cone.range_m` is h of the map.
  ViewSearch(const ViewCone& cone, std::vector<std::shared_ptr<const LoadedTile>> tiles);

  /// For each of the points, which are in the view camera's frame, whether a neighbour point lies within `radius_m`:
  /// one search in the tiles' KD-trees each.
  std::vector<bool> AnyWithin(std::span<const Eigen::Vector3f> p_camera, float radius_m);

  /// For each of the points (z > 0), whether a neighbour point lies within `radius` of it in scaled coordinates
  /// (view/sampler.h) that some neighbour frame saw from within 50 degrees of the view's ray to it (OVERLAP study).
  ///
  /// A ball in scaled coordinates is long and thin in metres. The metric ball around it, which a KD-tree of the tile
  /// would be asked for, holds hundreds of points; so the points of the view are brought to scaled coordinates once
  /// and searched there (docs/decisions/0005-overlap-search-in-scaled-coordinates.md has the measurement).
  std::vector<bool> AnyWithinScaled(std::span<const Eigen::Vector3f> p_camera, float radius);

  /// Scaled coordinates of the neighbour points in `scaled_box` that were seen from within 50 degrees of the view's
  /// ray.
  std::vector<Eigen::Vector3f> PointsSeenAlike(const Eigen::AlignedBox3f& scaled_box);

  const std::vector<std::shared_ptr<const LoadedTile>>& tiles() const { return tiles_; }

 private:
  enum class Judgement : uint8_t { kUnknown, kNeighbor, kStranger };

  bool IsNeighborFrame(size_t tile, uint32_t frame);
  bool HasNeighborObserver(size_t tile, const LoadedPoint& point);
  bool IsSeenAlike(size_t tile, const LoadedPoint& point);
  ViewCone cone_;
  Eigen::Matrix3f R_map_camera_;
  Eigen::Vector3f center_;
  std::vector<std::shared_ptr<const LoadedTile>> tiles_;
  std::vector<std::vector<Judgement>> judgements_;  // by tile, frame
};

/// Metric radius of a ball around a point that holds everything within `radius` of it in scaled coordinates.
float BoundingRadius(const Eigen::Vector3f& p_camera, float radius);

/// Greatest angle between the ray of a view and a frame's ray to the same point at which they see it alike, radians.
inline constexpr double kLikeViewAngle = 50.0 * std::numbers::pi / 180.0;

}  // namespace mapp
