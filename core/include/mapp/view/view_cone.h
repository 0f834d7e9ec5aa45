#pragma once

#include "mapp/geometry/pose3.h"
#include "mapp/map/tile.h"

#include <Eigen/Core>

#include <vector>

namespace mapp {

/// VCone = {P, h, FOV}: apex at the camera, axis along +z (paper section 4.1, equation 3).
struct ViewCone {
  Pose3 T_map_camera;
  double range_m = 20.0;     ///< h
  double field_of_view = 0;  ///< full opening angle, radians; pi and more means the whole half space or sphere

  bool Contains(const Eigen::Vector3d& p_map) const;
  /// A box that holds the cone (tight to the axis-aligned extent of apex, cap and rim).
  Aabb BoundingBox() const;
};

inline constexpr double kDefaultConeRangeM = 20.0;  ///< h, as ORB-SLAM3 and the paper have it

/// Neighbour test between a query pose and a map frame: centres nearer than T_D = 2h, optical axes closer than
/// (fov_query + fov_frame) / 2 (paper section 4.1, equations 5 and 6).
bool IsNeighbor(const ViewCone& query, const Pose3& T_map_frame, double frame_field_of_view);

/// Keys of the tiles whose cubes may meet the cone, nearest to the apex first.
std::vector<TileKey> TilesInView(const ViewCone& cone, const TileGrid& grid);

}  // namespace mapp
