#pragma once

#include "mapp/base/status.h"
#include "mapp/geometry/pose3.h"
#include "server/service/overlap_assessor.h"
#include "storage/records.h"

#include <Eigen/Core>

#include <span>
#include <vector>

namespace mapp {

class MapReader;

/// A pose that a device may come to.
struct WayPose {
  Pose3 T_map_camera;
  double way_m = 0;  ///< length of the way there
};

/// Poses straight on, looking as now; none for a motion of zero.
std::vector<WayPose> StraightAhead(const Pose3& T_map_camera, const Eigen::Vector3d& motion_map, double distance_m);

/// Poses of those who came by here looking alike, and going alike where the motion is not zero, from here on: of the
/// nearest few sessions, up to `distance_m` along their ways and to where these have a gap. By session; within one, in
/// the order of the way. `frames` are in the map, of any sessions.
std::vector<WayPose> EarlierWays(std::span<const FrameRecord> frames, const Pose3& T_map_camera,
                                 const Eigen::Vector3d& motion_map, double distance_m);

/// Where the device may be within `distance_m` of its way (DESIGN 9), nearest first: straight on, and, with
/// `earlier_ways`, where earlier sessions went on, whose frames are read from a box of that size.
StatusOr<std::vector<WayPose>> PredictWay(MapReader& reader, const MapView& view, const Eigen::Vector3d& motion_map,
                                          double distance_m, bool earlier_ways);

/// Tiles that may come into view along the way, each once, by where that is: those first that are met first.
std::vector<TileKey> TilesAhead(std::span<const WayPose> way, const ViewCone& cone, const TileGrid& grid);

}  // namespace mapp
