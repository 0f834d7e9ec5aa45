#pragma once

#include "mapp/view/view_cone.h"
#include "server/service/loaded_tile.h"

#include <cstdint>
#include <memory>
#include <numbers>
#include <vector>

namespace mapp {

/// Searches among the neighbour points of one view: the map points that its neighbour frames hold (DESIGN 5). Frames
/// are judged when first met. One thread only.
class ViewSearch {
 public:
  /// `cone.range_m` is h of the map.
  ViewSearch(const ViewCone& cone, std::vector<std::shared_ptr<const LoadedTile>> tiles);

  /// Whether a neighbour point lies within `radius_m` of the point, which is in the view camera's frame.
  bool AnyWithin(const Eigen::Vector3f& p_camera, float radius_m);
  /// Whether a neighbour point lies within `radius` of the point in scaled coordinates (view/sampler.h) that some
  /// neighbour frame saw from within 50 degrees of the view's ray to it (OVERLAP study).
  bool AnyWithinScaled(const Eigen::Vector3f& p_camera, float radius);

  const std::vector<std::shared_ptr<const LoadedTile>>& tiles() const { return tiles_; }

 private:
  enum class Judgement : uint8_t { kUnknown, kNeighbor, kStranger };

  struct ScaledPoint {
    Eigen::Vector3f position = Eigen::Vector3f::Zero();
    bool known = false;
  };

  bool IsNeighborFrame(size_t tile, uint32_t frame);
  /// Where the point lies in the view's scaled coordinates; infinitely far when no neighbour frame saw it from a like
  /// direction or it lies behind the camera.
  Eigen::Vector3f ScaledIfSeenAlike(size_t tile, const LoadedPoint& point);
  Eigen::Vector3f ToMap(const Eigen::Vector3f& p_camera) const { return R_map_camera_ * p_camera + center_; }

  ViewCone cone_;
  Eigen::Matrix3f R_map_camera_;
  Eigen::Vector3f center_;
  std::vector<std::shared_ptr<const LoadedTile>> tiles_;
  std::vector<std::vector<Judgement>> judgements_;       // by tile, frame
  std::vector<std::vector<ScaledPoint>> scaled_points_;  // by tile, slot; filled as points are met
};

/// Metric radius of a ball around a point that holds everything within `radius` of it in scaled coordinates.
float BoundingRadius(const Eigen::Vector3f& p_camera, float radius);

/// Greatest angle between the ray of a view and a frame's ray to the same point at which they see it alike, radians.
inline constexpr double kLikeViewAngle = 50.0 * std::numbers::pi / 180.0;

}  // namespace mapp
